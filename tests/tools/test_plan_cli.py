import json
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from placefield.errors import ConfigError, MapError
from placefield_tools.cli.main import app


def run_plan(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["plan", *map(str, arguments)])


def test_a_plan_prints_each_hosts_commands_and_says_that_it_estimates(map_path: Path) -> None:
    ended = run_plan(map_path, "--hosts", "2", "--cores", "2")
    assert ended.exit_code == 0, ended.output
    assert "an estimate, at 30 frames/s" in ended.output
    first, second = (ended.output.index(f"\nhost{number}, about ") for number in (1, 2))
    commands = [
        (position > second, shlex.split(line))
        for line in ended.output[first:].splitlines()
        if line.startswith("  placefield ")
        for position in [ended.output.index(line)]
    ]
    at = {False: ["--endpoint", "tcp/host1:7557"], True: ["--endpoint", "tcp/host2:7557"]}
    channels = ["--channel", "0", "--channel", "1", "--channel", "2"]
    place = str(map_path)
    assert commands == [
        (False, ["placefield", "router", *at[False]]),
        (False, ["placefield", "featurizer", place, *at[False]]),
        (False, ["placefield", "fuser", place, *at[False]]),
        (True, ["placefield", "router", *at[True], "--connect", "tcp/host1:7557"]),
        (True, ["placefield", "channel", place, *channels, *at[True]]),
    ]


def test_a_plan_as_json_is_one_object_with_the_names_that_were_given(map_path: Path) -> None:
    ended = run_plan(map_path, "--hosts", "cam,rack.example", "--cores", "1", "--json")
    figures = json.loads(ended.output)
    assert [host["name"] for host in figures["hosts"]] == ["cam", "rack.example"]
    assert (figures["rate"], figures["suffices"]) == (30.0, True)
    assert figures["highest_rate"] > 30
    processes = [process for host in figures["hosts"] for process in host["processes"]]
    assert [process["service"] for process in processes].count("channel") == 1
    for process in processes:
        assert 0 < process["core_share"] < 1
        assert process["own_bytes"] > 0
        assert process["command"].startswith(f"placefield {process['service']}")


def test_a_plan_of_a_run_names_it_in_every_command_of_a_service(map_path: Path) -> None:
    figures = json.loads(run_plan(map_path, "--run", "rear", "--json").output)
    for process in figures["hosts"][0]["processes"]:
        assert ("--run rear" in process["command"]) == (process["service"] != "router")


def test_a_host_that_is_not_needed_is_named_idle_and_has_no_commands(map_path: Path) -> None:
    ended = run_plan(map_path, "--hosts", "3", "--cores", "2")
    assert "host3 is idle: the others suffice." in ended.output
    assert "tcp/host3" not in ended.output
    hosts = json.loads(run_plan(map_path, "--hosts", "3", "--cores", "2", "--json").output)["hosts"]
    assert [host["idle"] for host in hosts] == [False, False, True]


def test_one_host_alone_stays_on_loopback_and_a_rate_beyond_it_is_said(map_path: Path) -> None:
    ended = run_plan(map_path, "--rate", "5000")
    assert ended.exit_code == 1, ended.output
    assert "--endpoint" not in ended.output
    assert "at 5000 frames/s a core would be busy for more than 70% of the time" in ended.output


def test_memory_that_hosts_have_not_is_said(map_path: Path) -> None:
    little = "--memory", "0.1"
    ended = run_plan(map_path, *little)
    assert ended.exit_code == 1, ended.output
    assert "too little memory: a host would need 0.5 GB" in ended.output
    assert not json.loads(run_plan(map_path, *little, "--json").output)["suffices"]


@pytest.mark.parametrize("hosts", ["0", "", "a,,b", "a,a", "1,2"])
def test_hosts_are_a_number_or_names_each_once(map_path: Path, hosts: str) -> None:
    ended = run_plan(map_path, f"--hosts={hosts}")
    assert isinstance(ended.exception, ConfigError)
    assert str(ended.exception).startswith(f"--hosts {hosts!r}: write their number")


def test_a_map_that_lacks_a_file_is_refused(tmp_path: Path) -> None:
    ended = run_plan(tmp_path / "no.pfmap")
    assert isinstance(ended.exception, MapError)
    assert "no map there" in str(ended.exception)
