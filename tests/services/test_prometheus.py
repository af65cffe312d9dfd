"""The metrics that Prometheus reads from a service."""

from collections.abc import Callable
from typing import Any
from urllib.request import urlopen

import pytest
from prometheus_client.parser import text_string_to_metric_families

from placefield.bus.messages import StatsMessage
from placefield.bus.session import Bus
from placefield.config import MonitoringConfig
from placefield.errors import ConfigError
from placefield_services.prometheus import ReceivedStats, ReportedStats, serve_metrics
from placefield_tools.common.host_process import free_endpoint

FUSER = ReportedStats(
    "day", "ab12", StatsMessage(service="fuser", counts={"matches": 7, "late": 1}, sequence=6)
)
LABELS = ("run", "service", "identity", "event")
SILENT = ReportedStats("night", "cd34", StatsMessage(service="channel", counts={}))


@pytest.fixture
def port() -> int:
    return int(free_endpoint().rpartition(":")[2])


def scraped(port: int) -> dict[tuple[str, ...], float]:
    with urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        text = answer.read().decode()
    return {
        (sample.name, *(sample.labels[name] for name in LABELS if name in sample.labels)): (
            sample.value
        )
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_prometheus_reads_the_statistics_of_the_moment(port: int) -> None:
    reported = [FUSER]
    serve_metrics(MonitoringConfig(port=port), lambda: reported)
    found = scraped(port)
    assert found["placefield_events_total", "day", "fuser", "ab12", "matches"] == 7
    assert found["placefield_events_total", "day", "fuser", "ab12", "late"] == 1
    assert found["placefield_newest_frame", "day", "fuser", "ab12"] == 6
    assert found["process_resident_memory_bytes",] > 2**20
    reported[:] = [SILENT]
    assert not [name for name in scraped(port) if name[0].startswith("placefield")]


def test_a_port_in_use_is_refused_in_one_line(port: int) -> None:
    serve_metrics(MonitoringConfig(port=port), list)
    with pytest.raises(ConfigError, match=rf"--metrics-port: cannot listen at .*:{port} "):
        serve_metrics(MonitoringConfig(port=port), list)


def test_nothing_is_served_where_no_port_is_given() -> None:
    def report() -> list[ReportedStats]:
        raise AssertionError

    serve_metrics(MonitoringConfig(), report)


class Stats(Bus):
    """Lets a test report on the bus."""

    def __init__(self) -> None: ...

    def subscribe_raw(self, key: str, receive: Callable[[str, bytes], None]) -> Any:
        self.report = receive


def test_a_host_exports_all_services_and_drops_silent_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bus = Stats()
    received_stats = ReceivedStats(bus, ["day"])
    bus.report("placefield/day/stats/fuser/ab12", FUSER.stats.encode())
    bus.report("placefield/day/stats/fuser/ab12", b"no message")
    assert received_stats.report() == [FUSER]
    monkeypatch.setattr("placefield_services.prometheus._SILENT_S", -1.0)
    assert not received_stats.report()
