"""The bus, as a doctor sees it."""

import json
import socket

import pytest

from placefield.bus.connecting import open_router
from placefield.bus.keys import Keys
from placefield.config import BusConfig
from placefield_tools.cli.main import main
from placefield_tools.doctor.finding import Finding, Health
from placefield_tools.doctor.network_check import network, of_endpoint, of_services


def looked_at(endpoint: str) -> list[Finding]:
    return list(network(BusConfig(endpoint=endpoint), ["day"]))


def test_a_router_without_services_is_good_and_they_are_missed(endpoint: str) -> None:
    with open_router(BusConfig(endpoint=endpoint)):
        router, services = looked_at(endpoint)
    assert router.verdict is Health.GOOD
    assert services.found == "no channel, no featurizer, no fuser"


def test_where_another_run_has_services_its_name_is_reported(endpoint: str) -> None:
    with open_router(BusConfig(endpoint=endpoint)) as bus:
        bus.declare_alive(Keys("night").alive("fuser", "ab"))
        _, services = looked_at(endpoint)
    assert services.advice.startswith("there is night: name one with --run, or start them")


def test_a_port_that_nobody_listens_at_is_no_fault_yet(endpoint: str) -> None:
    (found,) = looked_at(endpoint)
    assert found.verdict is Health.WARNING
    assert "placefield up" in found.advice


def test_another_program_at_the_port_is_bad(endpoint: str) -> None:
    with socket.create_server(("127.0.0.1", int(endpoint.rpartition(":")[2]))):
        (found,) = looked_at(endpoint)
    assert found.verdict is Health.BAD
    assert "another program has the port" in found.advice


def test_what_is_no_endpoint_is_reported_how_to_write_one() -> None:
    assert "tcp/HOST:PORT" in of_endpoint("7557").advice


def test_services_that_are_alive_are_good() -> None:
    assert of_services("day", {"featurizer", "channel", "fuser"}, {"day"}).verdict is Health.GOOD


def test_the_command_reports_all_as_json_and_fails_on_what_is_bad(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = ["doctor", "--json", "--endpoint", endpoint, "--camera", "camera:99"]
    monkeypatch.setattr("sys.argv", ["placefield", *flags])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    found = json.loads(capsys.readouterr().out)
    assert {"python", "cores", "router", "camera"} <= {finding["subject"] for finding in found}
    assert [finding["subject"] for finding in found if finding["verdict"] == "bad"] == ["camera"]
