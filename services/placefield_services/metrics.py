"""What services count, for Prometheus."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from placefield.bus.keys import Keys, run_of, service_and_identity
from placefield.bus.messages import StatsMessage
from placefield.bus.session import Bus
from placefield.config import MonitoringConfig
from placefield.errors import ConfigError, MessageError

_SILENT_S = 10.0  # a service tells once a second


@dataclass(frozen=True)
class Told:
    """What one process of a service has told of a run."""

    run: str
    identity: str
    stats: StatsMessage


Tell = Callable[[], Iterable[Told]]


def serve_metrics(monitoring: MonitoringConfig, tell: Tell) -> None:
    """Answer Prometheus with what ``tell`` says when it asks, as long as this process lives.

    Does nothing where no port is given.

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
    registry.register(_collector(tell))
    try:
        start_http_server(monitoring.port, monitoring.host, registry)
    except OSError as error:
        where = f"{monitoring.host}:{monitoring.port}"
        raise ConfigError(
            f"--metrics-port: cannot listen at {where} ({error.strerror}); give another port"
        ) from None


def _collector(tell: Tell):  # type: ignore[no-untyped-def]  # of a library that may be missing
    from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
    from prometheus_client.registry import Collector

    labels = ("run", "service", "identity")

    class Counts(Collector):
        def collect(self):  # type: ignore[no-untyped-def]
            events = CounterMetricFamily(
                "placefield_events", "What a service has counted.", labels=(*labels, "event")
            )
            newest = GaugeMetricFamily(
                "placefield_newest_frame", "Number of the newest frame answered.", labels=labels
            )
            for told in tell():
                of = told.run, told.stats.service, told.identity
                for event, count in told.stats.counts.items():
                    events.add_metric((*of, event), count)
                if told.stats.sequence is not None:
                    newest.add_metric(of, told.stats.sequence)
            yield events
            yield newest

    return Counts()


class Overheard:
    """What all services of some runs tell on the bus, from now on."""

    def __init__(self, bus: Bus, runs: Sequence[str]) -> None:
        self._newest: dict[str, tuple[float, StatsMessage]] = {}
        for run in runs:
            bus.subscribe_raw(Keys(run).all_stats, self._hear)

    def _hear(self, key: str, payload: bytes) -> None:
        try:
            stats = StatsMessage.decode(payload)
        except MessageError:
            return  # whoever it is for counts it
        self._newest[key] = time.monotonic(), stats

    def tell(self) -> Iterator[Told]:
        """Yield what those told that are not silent now."""
        now = time.monotonic()
        self._newest = {
            key: (when, stats)
            for key, (when, stats) in tuple(self._newest.items())
            if now - when < _SILENT_S
        }
        for key, (_, stats) in self._newest.items():
            yield Told(run_of(key), service_and_identity(key)[1], stats)
