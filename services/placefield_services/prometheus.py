"""Exports the counts of services to Prometheus."""

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from placefield.bus.keys import Keys, run_of, service_and_identity
from placefield.bus.messages import StatsMessage
from placefield.bus.session import LONGEST_STATS, MOST_TOKENS, Bus
from placefield.config import MonitoringConfig
from placefield.errors import ConfigError, MessageError

_SILENT_S = 10.0  # a service reports once a second


@dataclass(frozen=True)
class ReportedStats:
    """The statistics that one process of a service has reported for a run."""

    run: str
    identity: str
    stats: StatsMessage


Report = Callable[[], Iterable[ReportedStats]]


def serve_metrics(monitoring: MonitoringConfig, report: Report) -> None:
    """Serve metrics to Prometheus as long as this process lives; ``report`` is called each time.

    Without a port this does nothing.

    Raises:
        ConfigError: prometheus-client is missing, or the port cannot be listened at.
    """
    if monitoring.port is None:
        return
    try:
        from prometheus_client import CollectorRegistry, ProcessCollector, start_http_server
    except ModuleNotFoundError:
        raise ConfigError(
            "--metrics-port needs prometheus-client: pip install 'placefield[metrics]'"
        ) from None
    registry = CollectorRegistry()
    ProcessCollector(registry=registry)
    registry.register(_collector(report))
    try:
        start_http_server(monitoring.port, monitoring.host, registry)
    except OSError as error:
        where = f"{monitoring.host}:{monitoring.port}"
        raise ConfigError(
            f"--metrics-port: cannot listen at {where} ({error.strerror}); give another port"
        ) from None


def _collector(report: Report):  # type: ignore[no-untyped-def]  # the library may be missing
    from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
    from prometheus_client.registry import Collector

    labels = ("run", "service", "identity")

    class Counts(Collector):
        def collect(self):  # type: ignore[no-untyped-def]
            events = CounterMetricFamily(
                "placefield_events", "Events that a service has counted.", labels=(*labels, "event")
            )
            newest = GaugeMetricFamily(
                "placefield_newest_frame", "Number of the newest frame answered.", labels=labels
            )
            for reported in report():
                of = reported.run, reported.stats.service, reported.identity
                for event, count in reported.stats.counts.items():
                    events.add_metric((*of, event), count)
                if reported.stats.sequence is not None:
                    newest.add_metric(of, reported.stats.sequence)
            yield events
            yield newest

    return Counts()


class ReceivedStats:
    """The statistics that all services of some runs publish on the bus, from now on."""

    def __init__(self, bus: Bus, runs: Sequence[str]) -> None:
        self._newest: dict[str, tuple[float, ReportedStats]] = {}
        self._lock = threading.Lock()  # the bus and Prometheus use different threads
        for run in runs:
            bus.subscribe_raw(Keys(run).all_stats, self._receive)

    def _receive(self, key: str, payload: bytes) -> None:
        if len(payload) > LONGEST_STATS:
            return
        try:
            stats = StatsMessage.decode(payload)
        except MessageError:
            return  # other readers count it as malformed
        service, identity = service_and_identity(key)
        reported = ReportedStats(
            run_of(key), identity, stats.model_copy(update={"service": service})
        )
        with self._lock:
            if key not in self._newest and len(self._newest) >= MOST_TOKENS:
                return  # more come from an untrusted client
            self._newest[key] = time.monotonic(), reported

    def _drop_silent(self) -> None:
        since = time.monotonic() - _SILENT_S
        self._newest = {
            key: reported for key, reported in self._newest.items() if reported[0] > since
        }

    def report(self) -> list[ReportedStats]:
        """Return the newest statistics of each process that reported within the last 10 s."""
        with self._lock:
            self._drop_silent()
            return [reported for _, reported in self._newest.values()]
