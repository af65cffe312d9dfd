"""The stage from descriptor to candidates: some channels of a map, whole or one shard of each.

With no bus: a library, a study and a channel worker compose it alike.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.candidate import Candidate
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.matcher import Matcher, Partial, SmoothedCandidate
from placefield.matching.sharding import ChannelShard, MetricShards

Compared = Mapping[MapMetric, Comparison]
"""How a frame compares with the places under each metric of a stage."""


class ChannelStage:
    """Compares descriptors with the places of some channels; all streams in these share it.

    Attributes:
        channels: their numbers in the map.
        shard: which shard of each channel, from 0.
        shards: of how many; 1 is whole channels.
    """

    def __init__(
        self,
        channels: Mapping[int, MapChannel],
        matching: MatchingConfig,
        shard: int = 0,
        shards: int = 1,
        travelled: NDArray[np.float64] | None = None,
        same: NDArray[np.int32] | None = None,
    ) -> None:
        """Prepare channels; of shards, and for rules that compare windows, this reads all places.

        Args:
            channels: of the whole map, by their numbers in it.
            matching: how candidates are made.
            shard: which of each, from 0.
            shards: how many there are.
            travelled: (K,) metres up to each place of the map; None or empty: unknown.
            same: (K,) int32, which place of the map each is the same as; None: all differ.

        Raises:
            ConfigError: the map has too few places for so many shards.
        """
        self.channels = tuple(channels)
        self._rule = matching.rule
        self.shard, self.shards = shard, shards
        shared = MetricShards()
        self._parts = {
            number: ChannelShard(channel, matching, shard, shards, shared, travelled, same)
            for number, channel in channels.items()
        }
        exact = matching.compares_exactly
        self._places = {
            metric: MetricPlaces(metric, exact=exact)
            for metric in dict.fromkeys(channel.metric for channel in self._parts.values())
        }

    @property
    def dimensions(self) -> int:
        """N, of the descriptors."""
        return int(next(iter(self._places)).projection.shape[1])

    def compare(self, descriptors: Sequence[NDArray[np.float32]]) -> Iterator[Compared]:
        """Compare descriptors (N,) float32 of length 1 with the places, once per metric.

        Yields:
            How each compares, in order. It does not depend on the others, to the last bit.
        """
        if len(descriptors):
            stacked = np.asarray(descriptors)
            by_metric = [places.compare(stacked) for places in self._places.values()]
            for comparisons in zip(*by_metric, strict=True):
                yield dict(zip(self._places, comparisons, strict=True))

    def new_stream(self, first: int = 0, lag: int | None = None) -> "StreamMatcher":
        """Begin a stream.

        Args:
            first: number of its first frame.
            lag: see ``ChannelShard.new_matcher``.
        """
        groups = [
            _Group(numbers, part.metric, part.new_matcher(lag)) for numbers, part in self._groups()
        ]
        return StreamMatcher(groups, first)

    def _groups(self) -> Iterator[tuple[tuple[int, ...], ChannelShard]]:
        """Yield channels that answer alike: of the filter, those under one metric."""
        alike: dict[object, list[int]] = {}
        for number, part in self._parts.items():
            alike.setdefault(part.metric if self._rule == "filter" else number, []).append(number)
        for numbers in alike.values():
            yield tuple(numbers), self._parts[numbers[0]]


@dataclass
class _Group:
    """Channels that answer alike, so that one matcher answers for all.

    Attributes:
        numbers: of the channels.
        metric: theirs.
        matcher: of the stream.
        partial: of the frame whose local step was done.
        waiting: numbers of the frames that were answered, and not smoothed yet.
        smoothed: frames that were smoothed, and not asked for yet.
    """

    numbers: tuple[int, ...]
    metric: MapMetric
    matcher: Matcher
    partial: Partial | None = None
    waiting: deque[int] = field(default_factory=deque)
    smoothed: list[tuple[int, SmoothedCandidate]] = field(default_factory=list)

    def smooth(self, frames: list[SmoothedCandidate]) -> None:
        """Number what the matcher has smoothed, and keep it until it is asked for."""
        self.smoothed += [(self.waiting.popleft(), each) for each in frames]


class StreamMatcher:
    """Matches one stream in all channels of a stage, frame by frame.

    Each frame takes a local step and a reduce step in all channels. Frames that were missed take
    them, too, as missing observations, so that none is left out but those that change nothing.
    Should a channel fail in a step, the frame costs it its observation, and no other channel but
    those that answer alike.
    """

    def __init__(self, groups: Sequence[_Group], first: int) -> None:
        """Take the channels, and the number of the first frame."""
        self._groups = groups
        self._memory = max(group.matcher.memory for group in groups)
        self.next = first
        """The number of the frame whose steps are next."""
        self._end: int | None = None

    def local(
        self, compared: Compared | None, sequence: int, odometry_m: float | None = None
    ) -> Mapping[int, Partial]:
        """Do the local step of a frame, or of the next one before it that was missed.

        Args:
            compared: how the frame compares with the places; None is a missing observation.
            sequence: its number, ``next`` or greater. If it is greater, frames in between were
                missed, and ``next`` is afterwards the number of that whose step was done.
            odometry_m: the odometer's reading at the frame, metres since any fixed start; None:
                unknown, as it is at frames that were missed.

        Returns:
            The partial result of each channel, (n,) float64.
        """
        self.next = max(self.next, sequence - self._memory)
        frame, reading = (compared, odometry_m) if self.next == sequence else (None, None)
        for group in self._groups:
            if group.partial is None:  # it may be there if another channel failed
                observed = None if frame is None else frame[group.metric]
                group.partial = group.matcher.local(observed, reading)
        return {
            number: group.partial
            for group in self._groups
            for number in group.numbers
            if group.partial is not None
        }

    def reduce(self, partials: Mapping[int, Sequence[Partial]]) -> dict[int, Candidate]:
        """Finish the frame whose local step was done.

        Args:
            partials: of each channel, those of all its shards, in the order of the map.

        Returns:
            The candidate of each channel.
        """
        sequence, self.next = self.next, self.next + 1
        for group in self._groups:
            group.partial = None
        candidates: dict[int, Candidate] = {}
        for group in self._groups:
            candidate = group.matcher.reduce(partials[group.numbers[0]])
            group.waiting.append(sequence)
            group.smooth(group.matcher.smoothed())
            candidates |= dict.fromkeys(group.numbers, candidate)
        return candidates

    def fits(self, number: int, partial: Partial) -> bool:
        """Whether what came from another shard of a channel can be its partial result."""
        (group,) = (group for group in self._groups if number in group.numbers)
        return group.matcher.fits(partial)

    def smoothed(self) -> dict[int, list[tuple[int, SmoothedCandidate]]]:
        """Return the frames that each channel has smoothed since it was asked, by their numbers."""
        smoothed: dict[int, list[tuple[int, SmoothedCandidate]]] = {}
        for group in self._groups:
            smoothed |= dict.fromkeys(group.numbers, self._until_end(group.smoothed))
            group.smoothed = []
        return smoothed

    def _until_end(
        self, smoothed: list[tuple[int, SmoothedCandidate]]
    ) -> list[tuple[int, SmoothedCandidate]]:
        """Leave out what comes after the end, and do not count it as known."""
        end = self._end
        if end is None:
            return smoothed
        return [
            (number, each._replace(lag=min(each.lag, end - 1 - number)))
            for number, each in smoothed
            if number < end
        ]

    def end(self) -> int:
        """Say that no frame will come any more.

        Returns:
            How many missing observations are to be taken before ``finish``.
        """
        self._end = self.next
        return max(group.matcher.tail for group in self._groups)

    def finish(self) -> dict[int, list[tuple[int, SmoothedCandidate]]]:
        """Return the frames that are left, after ``end`` and what it asks for."""
        for group in self._groups:
            group.smooth(group.matcher.finish())
        return self.smoothed()

    def update(self, compared: Compared | None, odometry_m: float | None = None) -> list[Candidate]:
        """Return the candidates for the next frame, of whole channels, by ascending number.

        Args:
            compared: how the frame compares with the places; None is a missing observation.
            odometry_m: see ``local``.
        """
        partials = self.local(compared, self.next, odometry_m)
        candidates = self.reduce({number: [one] for number, one in partials.items()})
        return [candidates[number] for number in sorted(candidates)]
