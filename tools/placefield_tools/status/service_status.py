"""The status of a run's services: the newest frame and rate of each, and which are missing.

This module has no bus and no clock: callers pass the messages and their times.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from placefield.bus.keys import Part, part_of, service_and_identity
from placefield.bus.message import Header
from placefield.bus.messages import StatsMessage
from placefield.fusion.match import FASTER
from placefield_tools.common.natural_sort import counted, natural_key

SILENT_S = 3.0
"""A service is silent if it has sent no counts for so long; services send them once a second."""

_NO_FAULT = ("late", "stale", "duplicate", "repeated", "out_of_order")
_NAMED = 100  # names in one message, at most
_ONE_OF_A_RUN = ("featurizer", "fuser")
_REPORTING = (*_ONE_OF_A_RUN, "describer", "channel", "verifier", "mapserver", "mapper")


@dataclass(frozen=True)
class ServiceStatus:
    """The status of one service, or of one part of a channel worker.

    Attributes:
        service: name of the service.
        identity: identity in its liveliness token.
        part: the channel or shard that a channel worker serves; None for other services.
        stream: stream of the newest frame that the service has answered; None if it has answered
            none.
        sequence: number of that frame.
        behind: how many newer frames waited for the service when it reported that frame: sent ones
            for a featurizer, ones that all channels had reported for a fuser, if these are known,
            else described ones; None if it has answered no frame of the current stream.
        rate: frames per second that the service answered between its last two reports.
        silent: whether the service has not reported for ``SILENT_S`` seconds.
        counts: the service's counts since it started.
        map: digest of its map; None if it has none, or has not reported.
    """

    service: str
    identity: str
    part: Part | None
    stream: str | None
    sequence: int | None
    behind: int | None
    rate: float | None
    silent: bool
    counts: dict[str, int]
    map: str | None = None

    @property
    def name(self) -> str:
        """The service, and its part of the map: ``fuser``, or ``channel 2, shard 0/4``."""
        return self.service if self.part is None else _part_in_words(self.part)


@dataclass(frozen=True)
class RunStatus:
    """The status of a run.

    Attributes:
        stream: the current stream, as the services last reported it.
        newest: number of its newest announced frame; after the end of the stream, the number of its
            frames.
        channels: number of channels of the map; None if no fuser has reported it.
        services: the services, in the order of their names and identities.
        missing: the services that must be started for whole answers, in words.
    """

    stream: str | None
    newest: int | None
    channels: int | None
    services: tuple[ServiceStatus, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True)
class _Report:
    """A process's last report, its time, and the newest frame that it could have had by then."""

    stats: StatsMessage
    at: float
    given: int | None
    rate: float | None


class RunRecord:
    """The reports of a run's services. Times are in seconds of any monotonic clock."""

    def __init__(self) -> None:
        self._announced: Header | None = None
        self._sent: Header | None = None
        self._reports: dict[tuple[str, str], _Report] = {}

    def announce(self, header: Header) -> None:
        """Add the header of a descriptor message, which announces its frame to all services."""
        self._announced = _newer(header, self._announced)

    def announce_sent(self, header: Header) -> None:
        """Add the header of a frame message, which its source has sent to the featurizer."""
        self._sent = _newer(header, self._sent)

    def _given(self, service: str, stream: str | None) -> int | None:
        """Return the newest frame of a stream that waits for a service, as far as is known."""
        if service == "fuser" and (answered := self._answered_by_channels(stream)):
            return min(answered)
        is_first = service == "featurizer" and self._sent is not None
        newest = self._sent if is_first else self._announced
        return newest.sequence if newest is not None and newest.stream == stream else None

    def _answered_by_channels(self, stream: str | None) -> list[int]:
        """Return the frame of a stream that each channel worker has answered last."""
        channels = (of.stats for (name, _), of in self._reports.items() if name == "channel")
        of_stream = (stats.sequence for stats in channels if stats.stream == stream)
        return [sequence for sequence in of_stream if sequence is not None]

    def update(self, service: str, process: str, stats: StatsMessage, now: float) -> None:
        """Add a process's report of its own counts."""
        before = self._reports.get((service, process))
        rate = None if before is None else _rate(before, stats, now)
        self._reports[service, process] = _Report(
            stats, now, self._given(service, stats.stream), rate
        )

    def forget(self, service: str, process: str) -> None:
        """Remove the reports of a process that has ended."""
        self._reports.pop((service, process), None)

    def status(self, tokens: Iterable[str], now: float) -> RunStatus:
        """Return the status of the services that have these liveliness tokens.

        A service that has another map than the fuser is among the missing ones.

        Args:
            tokens: of the services that are alive.
            now: the time.
        """
        alive = sorted(map(service_and_identity, tokens))
        reports = {
            key: self._reports[key]
            for key in (process_of(*one) for one in alive)
            if key in self._reports
        }
        stream, newest = self._newest(reports)
        services = tuple(
            self._service(key, reports.get(process_of(*key)), stream, newest, now) for key in alive
        )
        expected = [of.stats.channels for of in reports.values() if of.stats.channels is not None]
        channels = max(expected, default=None)
        absent = [*missing(alive, channels), *_on_other_maps(reports)]
        return RunStatus(stream, newest, channels, services, tuple(absent))

    def _newest(self, reports: dict[tuple[str, str], _Report]) -> tuple[str | None, int | None]:
        """Return the current stream and the number of its newest frame."""
        if self._announced is not None:
            stream: str | None = self._announced.stream
        else:  # no frame was announced yet; the featurizer is the first to know of a stream
            in_turn = sorted(reports.items(), key=lambda item: item[0][0] != "featurizer")
            stream = next((of.stats.stream for _, of in in_turn if of.stats.stream), None)
        sequences = [of.stats.sequence for of in reports.values() if of.stats.stream == stream]
        if self._announced is not None:
            sequences.append(self._announced.sequence)
        return stream, max((each for each in sequences if each is not None), default=None)

    def _service(
        self,
        key: tuple[str, str],
        report: _Report | None,
        stream: str | None,
        newest: int | None,
        now: float,
    ) -> ServiceStatus:
        service, identity = key
        part = part_of(identity) if service == "channel" else None
        if report is None:
            silent = service in _REPORTING
            return ServiceStatus(service, identity, part, None, None, None, None, silent, {})
        stats, silent = report.stats, now - report.at > SILENT_S
        behind = None
        if newest is not None and stats.sequence is not None and stats.stream == stream:
            # Frames that came after the report are no delay, unless the service is silent.
            given = self._given(service, stream) if silent else report.given
            behind = max((newest if given is None else given) - stats.sequence, 0)
        return ServiceStatus(
            service,
            identity,
            part,
            stats.stream,
            stats.sequence,
            behind,
            None if silent else report.rate,
            silent,
            stats.counts,
            stats.map,
        )


def _newer(header: Header, newest: Header | None) -> Header:
    """Return the header of the newer frame; a new stream is newer."""
    if newest is None or newest.stream != header.stream or newest.sequence < header.sequence:
        return header
    return newest


def counts_in_words(counts: Mapping[str, int]) -> str:
    """Return counts as text: by name, but ``too_fast`` as a phrase, and last those of no fault."""
    shown = [name for name in sorted(counts) if name not in _NO_FAULT]
    words = ", ".join(
        f"{counted(counts[name], 'frame')} {FASTER}"
        if name == "too_fast"
        else f"{name} {counts[name]}"
        for name in shown
    )
    normal = ", ".join(f"{name} {counts[name]}" for name in sorted(_NO_FAULT) if name in counts)
    return "; ".join(filter(None, (words, normal and f"sent twice or late, no fault: {normal}")))


def other_runs(run: str, runs: Collection[str]) -> str | None:
    """Name the runs that exist if this run has no service; None if there is no other run."""
    if not runs or run in runs:
        return None
    names = sorted(runs, key=natural_key)
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"there is {', '.join(names[:_NAMED])}{more}: name one with --run"


def missing(alive: Collection[tuple[str, str]], channels: int | None) -> list[str]:
    """Name the services that a run misses for whole answers.

    A channel is complete if one worker serves all of it, or if workers serve all shards of one cut.
    If only some shards of a cut are served, the other shards are named.

    Args:
        alive: service and identity of each living service.
        channels: number of channels of the map; None if unknown: then only channels with a living
            worker are checked.
    """
    services = {service for service, _ in alive}
    absent = [service for service in _ONE_OF_A_RUN if service not in services]
    parts = {part for service, name in alive if service == "channel" and (part := part_of(name))}
    numbers = range(channels) if channels is not None else sorted({part.channel for part in parts})
    by_channel: defaultdict[int, set[Part]] = defaultdict(set)
    for part in parts:
        by_channel[part.channel].add(part)
    for number in numbers:
        absent += _missing_of(number, by_channel.get(number, set()))
    if channels is None and not parts:
        absent.append("channel")
    more = len(absent) - _NAMED
    return absent if more <= 0 else [*absent[:_NAMED], f"and {more} more"]


def _missing_of(channel: int, parts: set[Part]) -> list[str]:
    if not parts:
        return [f"channel {channel}"]
    cuts = {
        shards: {part.shard for part in parts if part.shards == shards}
        for shards in sorted({part.shards for part in parts})
    }
    # The cut with the fewest missing shards is the intended one.
    shards, there = min(cuts.items(), key=lambda cut: cut[0] - len(cut[1]))
    return [
        _part_in_words(Part(channel, shard, shards))
        for shard in range(shards)
        if shard not in there
    ]


def _part_in_words(part: Part) -> str:
    shard = f", shard {part.shard}/{part.shards}" if part.shards > 1 else ""
    return f"channel {part.channel}{shard}"


def process_of(service: str, identity: str) -> tuple[str, str]:
    """Return the service and the process name under which the owner of a token reports."""
    return service, identity.rpartition("-")[2]


def _rate(before: _Report, stats: StatsMessage, now: float) -> float | None:
    old = before.stats
    if stats.sequence is None or old.sequence is None or stats.stream != old.stream:
        return None
    elapsed = now - before.at
    return max(stats.sequence - old.sequence, 0) / elapsed if elapsed > 0 else None


def _on_other_maps(reports: Mapping[tuple[str, str], _Report]) -> list[str]:
    """Name the services that have another map than the fuser."""
    maps = {key: of.stats.map for key, of in reports.items() if of.stats.map is not None}
    own = next((found for (service, _), found in maps.items() if service == "fuser"), None)
    return [
        f"{service} {process} on map {own}: it has {found}"
        for (service, process), found in maps.items()
        if own not in (None, found)
    ]
