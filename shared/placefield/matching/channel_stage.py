"""The stage from descriptors to candidates: some channels of a map, whole or one shard of each.

It has no bus: the library, a study and a channel worker all use it.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.maps.map import MapChannel, MapMetric
from placefield.maps.topology import Topology
from placefield.matching.candidate import Candidate
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.matcher import Matcher, Partial, SmoothedCandidate
from placefield.matching.sharding import ChannelShard, MetricShards

Compared = Mapping[MapMetric, Comparison]
"""The comparisons of a frame with the places, under each metric of a stage."""


class ChannelStage:
    """Compares descriptors with the places of some channels; all their streams share it.

    Attributes:
        channels: their numbers in the map.
        shard: index of the shard of each channel, from 0.
        shards: how many shards a channel has; 1 is a whole channel.
    """

    def __init__(
        self,
        channels: Mapping[int, MapChannel],
        matching: MatchingConfig,
        shard: int = 0,
        shards: int = 1,
        topology: Topology | None = None,
    ) -> None:
        """Prepare channels. For shards, and for rules that compare windows, this reads all places.

        Args:
            channels: of the whole map, by their numbers in it.
            matching: how candidates are made.
            shard: index of the shard of each channel, from 0.
            shards: how many there are.
            topology: of the map; None: one route of unknown metres, whose places all differ.

        Raises:
            ConfigError: the map has too few places for so many shards, or links that the rule does
                not follow.
        """
        self.channels = tuple(channels)
        self._rule = matching.rule
        self.shard, self.shards = shard, shards
        shared = MetricShards()
        self._parts = {
            number: ChannelShard(channel, matching, shard, shards, shared, topology)
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
            The comparisons of each descriptor, in order. They do not depend on the other
            descriptors, to the last bit.
        """
        if len(descriptors):
            stacked = np.asarray(descriptors)
            by_metric = [places.compare(stacked) for places in self._places.values()]
            for comparisons in zip(*by_metric, strict=True):
                yield dict(zip(self._places, comparisons, strict=True))

    def new_stream(self, first: int = 0, lags: Sequence[int] | None = None) -> "StreamMatcher":
        """Begin a stream.

        Args:
            first: number of its first frame.
            lags: see ``ChannelShard.new_matcher``.
        """
        count = 1 if lags is None else len(lags)
        groups = [
            _Group(
                numbers, part.metric, part.new_matcher(lags), [_Smoothed() for _ in range(count)]
            )
            for numbers, part in self._groups()
        ]
        return StreamMatcher(groups, first)

    def _groups(self) -> Iterator[tuple[tuple[int, ...], ChannelShard]]:
        """Yield channels with equal candidates: under ``filter``, those of one metric."""
        alike: dict[object, list[int]] = {}
        for number, part in self._parts.items():
            alike.setdefault(part.metric if self._rule == "filter" else number, []).append(number)
        for numbers in alike.values():
            yield tuple(numbers), self._parts[numbers[0]]


@dataclass
class _Smoothed:
    """The frames of a group that are smoothed with one lag.

    Attributes:
        waiting: numbers of the frames that have a candidate and are not smoothed yet.
        frames: those that were smoothed and not fetched yet, with their numbers.
    """

    waiting: deque[int] = field(default_factory=deque)
    frames: list[tuple[int, SmoothedCandidate]] = field(default_factory=list)

    def add(self, smoothed: Sequence[SmoothedCandidate]) -> None:
        """Number the frames that the matcher smoothed, and keep them until they are fetched."""
        self.frames += [(self.waiting.popleft(), each) for each in smoothed]


@dataclass
class _Group:
    """Channels with equal candidates, so that one matcher serves all of them.

    Attributes:
        numbers: of the channels.
        metric: of the channels.
        matcher: of the stream.
        smoothed: of the stream, by the index of the lag.
        partial: of the frame whose local step was done.
    """

    numbers: tuple[int, ...]
    metric: MapMetric
    matcher: Matcher
    smoothed: list[_Smoothed]
    partial: Partial | None = None

    def smooth(self, sequence: int) -> None:
        """Keep what the matcher smoothed in the reduce step of a frame until it is fetched."""
        for which, smoothed in enumerate(self.smoothed):
            smoothed.waiting.append(sequence)
            smoothed.add(self.matcher.smoothed(which))

    def finish(self) -> None:
        """Smooth the remaining frames: the stream is over."""
        for which, smoothed in enumerate(self.smoothed):
            smoothed.add(self.matcher.finish(which))


class StreamMatcher:
    """Matches one stream in all channels of a stage, frame by frame.

    Each frame takes a local step and a reduce step in all channels. So do frames that were skipped,
    as missing observations, except for those that would make no difference. If a channel fails in a
    step, it loses its observation of the frame, together with the channels of its group; the other
    channels are not affected.
    """

    def __init__(self, groups: Sequence[_Group], first: int) -> None:
        """Begin with groups of channels, and the number of the first frame."""
        self._groups = groups
        self._horizon = max(group.matcher.horizon for group in groups)
        self.next = first
        """The number of the frame whose steps are next."""
        self._end: int | None = None

    def local(
        self, compared: Compared | None, sequence: int, odometry_m: float | None = None
    ) -> Mapping[int, Partial]:
        """Do the local step of a frame, or of the next skipped one before it.

        Args:
            compared: the comparisons of the frame; None is a missing observation.
            sequence: the frame's number, at least ``next``. If it is greater, the frames in between
                were skipped, and ``next`` is afterwards the number of the frame whose step was
                done.
            odometry_m: the odometer's reading at the frame, metres since any fixed start; None:
                unknown. Skipped frames have none.

        Returns:
            The partial result of each channel, (n,) float64.
        """
        self.next = max(self.next, sequence - self._horizon)
        frame, reading = (compared, odometry_m) if self.next == sequence else (None, None)
        for group in self._groups:
            if group.partial is None:  # it exists if another channel failed in this step
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
            group.smooth(sequence)
            candidates |= dict.fromkeys(group.numbers, candidate)
        return candidates

    def fits(self, number: int, partial: Partial) -> bool:
        """Whether a partial result of another shard of a channel may be for this frame."""
        (group,) = (group for group in self._groups if number in group.numbers)
        return group.matcher.fits(partial)

    def smoothed(self, which: int = 0) -> dict[int, list[tuple[int, SmoothedCandidate]]]:
        """Return the frames that each channel smoothed since the last call, with their numbers.

        Args:
            which: index of the lag among those of the stream.
        """
        smoothed: dict[int, list[tuple[int, SmoothedCandidate]]] = {}
        for group in self._groups:
            kept = group.smoothed[which]
            smoothed |= dict.fromkeys(group.numbers, self._until_end(kept.frames))
            kept.frames = []
        return smoothed

    def _until_end(
        self, smoothed: list[tuple[int, SmoothedCandidate]]
    ) -> list[tuple[int, SmoothedCandidate]]:
        """Leave out frames after the end of the stream, and do not count them in the lag."""
        end = self._end
        if end is None:
            return smoothed
        return [
            (number, each._replace(lag=min(each.lag, end - 1 - number)))
            for number, each in smoothed
            if number < end
        ]

    def end(self) -> int:
        """Announce the end of the stream.

        Returns:
            How many missing observations to add before ``finish``.
        """
        self._end = self.next
        return max(group.matcher.tail for group in self._groups)

    def finish(self) -> None:
        """Smooth the remaining frames, after ``end`` and its missing observations."""
        for group in self._groups:
            group.finish()

    def update(self, compared: Compared | None, odometry_m: float | None = None) -> list[Candidate]:
        """Return the candidates for the next frame, of whole channels, by ascending number.

        Args:
            compared: the comparisons of the frame; None is a missing observation.
            odometry_m: see ``local``.
        """
        partials = self.local(compared, self.next, odometry_m)
        candidates = self.reduce({number: [one] for number, one in partials.items()})
        return [candidates[number] for number in sorted(candidates)]
