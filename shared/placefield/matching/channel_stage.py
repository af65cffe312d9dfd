"""The stage from descriptor to candidates: some channels of a map, whole or one shard of each.

With no bus: a library, a study and a channel worker compose it alike.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.candidate import Candidate
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.matcher import Matcher, Partial, Settled
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
    ) -> None:
        """Prepare channels; of shards, and for rules that compare windows, this reads all places.

        Args:
            channels: of the whole map, by their numbers in it.
            matching: how candidates are made.
            shard: which of each, from 0.
            shards: how many there are.

        Raises:
            ConfigError: the map has too few places for so many shards.
        """
        self.channels = tuple(channels)
        self.shard, self.shards = shard, shards
        shared = MetricShards()
        self._parts = {
            number: ChannelShard(channel, matching, shard, shards, shared)
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

    def new_stream(self, first: int = 0) -> "StreamMatcher":
        """Begin a stream with the frame of this number."""
        matchers = {
            number: (channel.metric, channel.new_matcher())
            for number, channel in self._parts.items()
        }
        return StreamMatcher(matchers, first)


class StreamMatcher:
    """Matches one stream in all channels of a stage, frame by frame.

    Each frame takes a local step and a reduce step in all channels. Frames that were missed take
    them, too, as missing observations, so that none is left out but those that change nothing.
    Should a channel fail in a step, the frame costs it its observation, and no other channel.
    """

    def __init__(self, matchers: Mapping[int, tuple[MapMetric, Matcher]], first: int) -> None:
        """Take each channel's metric and new matcher, and the number of the first frame."""
        self._matchers = matchers
        self._memory = max(matcher.memory for _, matcher in matchers.values())
        self._partials: dict[int, Partial] = {}
        self._unsettled: dict[int, deque[int]] = {number: deque() for number in matchers}
        self.next = first
        """The number of the frame whose steps are next."""

    def local(self, compared: Compared | None, sequence: int) -> Mapping[int, Partial]:
        """Do the local step of a frame, or of the next one before it that was missed.

        Args:
            compared: how the frame compares with the places; None is a missing observation.
            sequence: its number, ``next`` or greater. If it is greater, frames in between were
                missed, and ``next`` is afterwards the number of that whose step was done.

        Returns:
            The partial result of each channel, (n,) float64.
        """
        self.next = max(self.next, sequence - self._memory)
        frame = compared if self.next == sequence else None
        for number, (metric, matcher) in self._matchers.items():
            if number not in self._partials:  # it may be there if another channel failed
                self._partials[number] = matcher.local(None if frame is None else frame[metric])
        return self._partials

    def reduce(self, partials: Mapping[int, Sequence[Partial]]) -> dict[int, Candidate]:
        """Finish the frame whose local step was done.

        Args:
            partials: of each channel, those of all its shards, in the order of the map.

        Returns:
            The candidate of each channel.
        """
        self._partials = {}
        sequence, self.next = self.next, self.next + 1
        candidates = {}
        for number, (_, matcher) in self._matchers.items():
            candidates[number] = matcher.reduce(partials[number])
            self._unsettled[number].append(sequence)
        return candidates

    def fits(self, number: int, partial: Partial) -> bool:
        """Whether what came from another shard of a channel can be its partial result."""
        return self._matchers[number][1].fits(partial)

    def settled(self) -> dict[int, list[tuple[int, Settled]]]:
        """Return the frames that each channel has settled with the last one, by their numbers."""
        return {
            number: self._numbered(number, matcher.settled())
            for number, (_, matcher) in self._matchers.items()
        }

    def finish(self) -> dict[int, list[tuple[int, Settled]]]:
        """Return the frames that are left: the stream is over."""
        return {
            number: self._numbered(number, matcher.finish())
            for number, (_, matcher) in self._matchers.items()
        }

    def _numbered(self, number: int, settled: list[Settled]) -> list[tuple[int, Settled]]:
        return [(self._unsettled[number].popleft(), each) for each in settled]

    def push(self, compared: Compared | None) -> list[Candidate]:
        """Return the candidates for the next frame, of whole channels, in their order.

        Args:
            compared: how the frame compares with the places; None is a missing observation.
        """
        partials = self.local(compared, self.next)
        return list(self.reduce({number: [one] for number, one in partials.items()}).values())
