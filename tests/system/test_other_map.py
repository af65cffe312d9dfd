"""A map that replaces the served map and is no version of it: the maps are not mixed."""

import json
import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from hosting import Host, Listener, Process, placefield, wait_until

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.matching.candidate import UNANSWERED
from placefield_tools.record.records import read_records

BEFORE = 15
"""Frames that are answered before the map is another one."""


@pytest.fixture
def served(tmp_path: Path, map_path: Path) -> Path:
    return Path(copytree(map_path, tmp_path / "served.pfmap"))


def build_anew(served: Path, route_map: Map) -> str:
    """Put a map of another model in its place, as ``build --overwrite`` does; return its digest."""
    model = replace(route_map.model, mean=np.array(route_map.model.mean) + 1)
    save_map(replace(route_map, model=model), served)
    return open_map(served).digest


def test_a_host_starts_no_service_again_on_another_map_and_says_so(
    logs: Path, served: Path, route_map: Map
) -> None:
    with Host(logs, served, "--workers", "1") as host:
        build_anew(served, route_map)
        (process,) = host.service("channel")
        process.kill()
        wait_until(lambda: not host.runs, "the host gives up")
        lines = [line for line in host.err.splitlines() if line.startswith("placefield: ")]
    refused = f"placefield: {served}: is no version of the served map"
    assert any(line.startswith(refused) for line in lines)
    assert re.search("channel.* ended with code 1 .*times in a row", lines[-1])
    assert host.stop(signal.SIGTERM) == 1


@contextmanager
def services(logs: Path, served: Path, endpoint: str) -> Iterator[Process]:
    """Run a featurizer, a worker of all channels and a fuser by themselves; yield the fuser."""
    at = ("--endpoint", endpoint)
    channels = [flag for number in range(3) for flag in ("--channel", str(number))]
    with ExitStack() as running:
        running.enter_context(Process(logs, "router", *at))
        running.enter_context(Process(logs, "featurizer", served, *at))
        running.enter_context(Process(logs, "channel", served, *channels, *at))
        yield running.enter_context(Process(logs, "fuser", served, *at))


def test_fuser_and_status_refuse_another_map_and_each_recorded_match_names_its_own(
    logs: Path, tmp_path: Path, served: Path, route_map: Map, query_dir: Path, endpoint: str
) -> None:
    at = ("--endpoint", endpoint)
    drive = tmp_path / "drive.jsonl"
    with (
        services(logs, served, endpoint) as fuser,
        open_bus(BusConfig(endpoint=endpoint, connect_timeout_s=60)) as bus,
        Process(logs, "record", drive, *at) as record,
    ):
        listener = Listener(bus)
        for service, count in (("featurizer", 1), ("fuser", 1), ("channel", 3)):
            wait_until(lambda s=service, n=count: len(listener.alive(s)) == n, f"{service} is up")
        wait_until(lambda: "\n" in record.out, "it records")
        deadline = ("--set", "fusion.deadline_s=0.2")
        with Process(logs, "replay", query_dir, "--rate", "8", *at) as replay:
            listener.answers(count=BEFORE)
            fuser.stop(signal.SIGKILL)
            other = build_anew(served, route_map)
            with Process(logs, "fuser", served, *deadline, *at) as another:
                wait_until(lambda: not replay.runs, "the replay is over")
                wait_until(lambda: listener.count("fuser", "other_map") > BEFORE, "it is reported")
                status = placefield("status", *at)
                named = placefield("status", "--json", *at)
                assert "of map" in another.err
        assert record.stop(signal.SIGINT) == 0
    assert status.returncode == 1
    assert f"on map {other}: it has {route_map.digest}" in status.stderr
    assert len(status.stderr.splitlines()) == 1
    assert len(json.loads(named.stdout)["missing"]) == 1
    recorded = [one.match for one in read_records(drive)]
    assert {match.map for match in recorded} == {route_map.digest, other}
    assert {match.place for match in recorded if match.map == other} == {UNANSWERED}
