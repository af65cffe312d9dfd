"""How the services of a run stand: how far each is, how fast, and what is missing.

Pure: it is told what was heard, and when.
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
"""Every service tells of itself once a second; one that has not for so long is silent."""

_NAMED = 100  # at most, of what there may be thousands
_ONE_OF_A_RUN = ("featurizer", "fuser")
_TELLING = (*_ONE_OF_A_RUN, "channel", "mapserver")


@dataclass(frozen=True)
class ServiceStanding:
    """How one service stands, or one part of a channel worker.

    Attributes:
        service: its name.
        identity: of its token.
        part: which channel or shard it serves, if it is a channel worker.
        stream: of the newest frame that it has answered; none if it has answered none.
        sequence: of that frame.
        behind: how many frames newer than that one had been announced when it told so; none if it
            has answered none of the stream that is on.
        rate: frames per second that it has answered from the last time it told so to this.
        silent: whether nothing was heard of it lately.
        counts: what it has counted since it started.
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


@dataclass(frozen=True)
class RunStanding:
    """How a run stands.

    Attributes:
        stream: that is on, as far as anyone has told.
        newest: sequence of the newest frame of it that was announced; at its end, how many it had.
        channels: of the map; none where no fuser tells.
        services: by name and identity.
        missing: what must be started for whole answers, in words.
    """

    stream: str | None
    newest: int | None
    channels: int | None
    services: tuple[ServiceStanding, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True)
class _Told:
    """What a process told, when, and the newest frame that had been announced then."""

    stats: StatsMessage
    at: float
    announced: Header | None
    rate: float | None


class RunRecord:
    """What has been heard of a run, with the time in seconds of any clock that never goes back."""

    def __init__(self, digest: str | None = None) -> None:
        """Take the digest of the map that the services should have; None: the fuser's."""
        self._digest = digest
        self._announced: Header | None = None
        self._told: dict[tuple[str, str], _Told] = {}

    def announce(self, header: Header) -> None:
        """Take the header of a descriptor, which announces its frame to all."""
        newest = self._announced
        if newest is None or newest.stream != header.stream or newest.sequence < header.sequence:
            self._announced = header

    def tell(self, service: str, process: str, stats: StatsMessage, now: float) -> None:
        """Take what a process tells of itself."""
        before = self._told.get((service, process))
        rate = None if before is None else _rate(before, stats, now)
        self._told[service, process] = _Told(stats, now, self._announced, rate)

    def forget(self, service: str, process: str) -> None:
        """Forget what a process told that is no more."""
        self._told.pop((service, process), None)

    def standing(self, tokens: Iterable[str], now: float) -> RunStanding:
        """Say how the services stand that have these liveliness tokens."""
        alive = sorted(map(service_and_identity, tokens))
        told = {
            key: self._told[key] for key in (process_of(*one) for one in alive) if key in self._told
        }
        stream, newest = self._newest(told)
        services = tuple(
            self._service(key, told.get(process_of(*key)), stream, newest, now) for key in alive
        )
        expected = [of.stats.channels for of in told.values() if of.stats.channels is not None]
        channels = max(expected, default=None)
        lacking = [*missing(alive, channels), *self._on_other_maps(told)]
        return RunStanding(stream, newest, channels, services, tuple(lacking))

    def _on_other_maps(self, told: Mapping[tuple[str, str], _Told]) -> list[str]:
        """Say which services have another map than they should."""
        maps = {key: of.stats.map for key, of in told.items() if of.stats.map is not None}
        of_fusers = (digest for (service, _), digest in maps.items() if service == "fuser")
        own = self._digest or next(of_fusers, None)
        return [
            f"{service} {process} on map {own}: it has {digest}"
            for (service, process), digest in maps.items()
            if own not in (None, digest)
        ]

    def _newest(self, told: dict[tuple[str, str], _Told]) -> tuple[str | None, int | None]:
        """Return the stream that is on, and its newest frame."""
        if self._announced is not None:
            stream: str | None = self._announced.stream
        else:  # nothing has come since; the featurizer knows of a stream before the others do
            in_turn = sorted(told.items(), key=lambda item: item[0][0] != "featurizer")
            stream = next((of.stats.stream for _, of in in_turn if of.stats.stream), None)
        sequences = [of.stats.sequence for of in told.values() if of.stats.stream == stream]
        if self._announced is not None:
            sequences.append(self._announced.sequence)
        return stream, max((each for each in sequences if each is not None), default=None)

    def _service(
        self,
        key: tuple[str, str],
        told: _Told | None,
        stream: str | None,
        newest: int | None,
        now: float,
    ) -> ServiceStanding:
        service, identity = key
        part = part_of(identity) if service == "channel" else None
        if told is None:
            silent = service in _TELLING
            return ServiceStanding(service, identity, part, None, None, None, None, silent, {})
        stats, silent = told.stats, now - told.at > SILENT_S
        behind = None
        if newest is not None and stats.sequence is not None and stats.stream == stream:
            then = told.announced
            knew = not silent and then is not None and then.stream == stream
            # What was announced since it told is no delay of it, unless it has fallen silent.
            behind = max((then.sequence if then and knew else newest) - stats.sequence, 0)
        return ServiceStanding(
            service,
            identity,
            part,
            stats.stream,
            stats.sequence,
            behind,
            None if silent else told.rate,
            silent,
            stats.counts,
        )


def counts_in_words(counts: Mapping[str, int]) -> str:
    """Say what was counted: by its name, but for what a person is to be told in words."""
    return ", ".join(
        f"{counted(count, 'frame')} {FASTER}" if name == "too_fast" else f"{name} {count}"
        for name, count in sorted(counts.items())
    )


def other_runs(run: str, runs: Collection[str]) -> str | None:
    """Say which runs there are where one of this name has no service; None if there is no other."""
    if not runs or run in runs:
        return None
    names = sorted(runs, key=natural_key)
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"there is {', '.join(names[:_NAMED])}{more}: name one with --run"


def missing(alive: Collection[tuple[str, str]], channels: int | None) -> list[str]:
    """Say what a run lacks for whole answers.

    A channel is there as a whole, or as all shards of one cut; of a cut of which some are there,
    the others are named.

    Args:
        alive: services and identities.
        channels: of the map; None if unknown: those of which any shard is there.
    """
    services = {service for service, _ in alive}
    lacking = [service for service in _ONE_OF_A_RUN if service not in services]
    parts = {part for service, name in alive if service == "channel" and (part := part_of(name))}
    numbers = range(channels) if channels is not None else sorted({part.channel for part in parts})
    by_channel: defaultdict[int, set[Part]] = defaultdict(set)
    for part in parts:
        by_channel[part.channel].add(part)
    for number in numbers:
        lacking += _missing_of(number, by_channel.get(number, set()))
    if channels is None and not parts:
        lacking.append("channel")
    more = len(lacking) - _NAMED
    return lacking if more <= 0 else [*lacking[:_NAMED], f"and {more} more"]


def _missing_of(channel: int, parts: set[Part]) -> list[str]:
    if not parts:
        return [f"channel {channel}"]
    cuts = {
        shards: {part.shard for part in parts if part.shards == shards}
        for shards in sorted({part.shards for part in parts})
    }
    # The cut that lacks least is the one meant.
    shards, there = min(cuts.items(), key=lambda cut: cut[0] - len(cut[1]))
    return [
        f"channel {channel}, shard {shard}/{shards}"
        for shard in range(shards)
        if shard not in there
    ]


def process_of(service: str, identity: str) -> tuple[str, str]:
    """Return the service and name under which a process tells of itself that has this token."""
    return service, identity.rpartition("-")[2]


def _rate(before: _Told, stats: StatsMessage, now: float) -> float | None:
    old = before.stats
    if stats.sequence is None or old.sequence is None or stats.stream != old.stream:
        return None
    elapsed = now - before.at
    return max(stats.sequence - old.sequence, 0) / elapsed if elapsed > 0 else None
