"""What a worker serves: channels of a map, or shards of them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.maps.map import Map, MapMetric
from placefield.matching.channel_matcher import matcher_of
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.rehearsing import rehearse
from placefield.matching.shard_matcher import ShardMatcher
from placefield.matching.sharding import ChannelShard, ShardMetrics
from placefield_services.channel_streams import ChannelStream, Outlet, Seen, WholeStream
from placefield_services.shard_streams import ShardStream

Descriptor = NDArray[np.float32]
Sights = Iterator[Callable[[], Seen]]
"""What tells how frames compare with the places, to be called in their order."""


class ServedChannels(ABC):
    """The channels of a worker, or shards of them."""

    needs_all: bool
    """Whether no frame may be left out that others have taken."""

    def __init__(self, placemap: Map, channels: Sequence[int], matching: MatchingConfig) -> None:
        """Take the channels' numbers in a map."""
        self._channels = {number: placemap.channels[number] for number in channels}
        self._matching = matching
        # Called before reading, for what was cut off would end the process, and again after.
        self._check_unchanged = placemap.check_unchanged
        self._places: dict[MapMetric, MetricPlaces] = {}

    def _compare_under(self, metrics: Iterable[MapMetric]) -> None:
        """Compare frames under each of these metrics once."""
        exact = self._matching.compares_exactly
        self._places = {
            metric: MetricPlaces(metric, exact=exact) for metric in dict.fromkeys(metrics)
        }

    @abstractmethod
    def rehearse(self) -> None:
        """Match frames of no stream, so that what is made at its first use is made."""

    @abstractmethod
    def new_stream(self, outlet: Outlet, first: int) -> ChannelStream:
        """Begin a stream with the frame of this number.

        Raises:
            MapError: somebody has written to the map meanwhile.
        """

    @abstractmethod
    def sights(self, descriptors: Sequence[Descriptor | None]) -> Sights:
        """Yield what tells how each descriptor compares; None is a frame that was not seen."""

    def _compare(self, descriptors: Sequence[Descriptor]) -> Iterator[dict[MapMetric, Comparison]]:
        """Yield how each descriptor compares with the places, under each metric.

        Raises:
            MapError: somebody has written to the map meanwhile.
        """
        if descriptors:
            self._check_unchanged()
            stacked = np.stack(descriptors)
            by_metric = [of_metric.compare(stacked) for of_metric in self._places.values()]
            for comparisons in zip(*by_metric, strict=True):
                self._check_unchanged()
                yield dict(zip(self._places, comparisons, strict=True))


class WholeChannels(ServedChannels):
    """Whole channels: frames that come together are compared together."""

    needs_all = False

    def __init__(self, placemap: Map, channels: Sequence[int], matching: MatchingConfig) -> None:
        """Take the channels' numbers in a map."""
        super().__init__(placemap, channels, matching)
        self._compare_under(channel.metric for channel in self._channels.values())

    def rehearse(self) -> None:
        """Match frames of no stream, so that what is made at its first use is made."""
        rehearse(self._channels.values(), self._matching)

    def new_stream(self, outlet: Outlet, first: int) -> ChannelStream:
        """Begin a stream with the frame of this number."""
        self._check_unchanged()
        rule, reverse = self._matching.rule, self._matching.reverse
        matchers = {
            number: (channel.metric, matcher_of(channel, rule, reverse=reverse))
            for number, channel in self._channels.items()
        }
        return WholeStream(matchers, rule, first, outlet.candidates)

    def sights(self, descriptors: Sequence[Descriptor | None]) -> Sights:
        """Yield what tells how each descriptor compares; None is a frame that was not seen."""
        compared = self._compare([one for one in descriptors if one is not None])
        for descriptor in descriptors:
            yield dict if descriptor is None else partial(next, compared)


class ShardedChannels(ServedChannels):
    """A shard of each channel: a frame may have to wait, and is compared when its turn has come."""

    needs_all = True

    def __init__(
        self,
        placemap: Map,
        channels: Sequence[int],
        matching: MatchingConfig,
        shard: int,
        shards: int,
    ) -> None:
        """Take the channels' numbers in a map, and which shard of how many."""
        super().__init__(placemap, channels, matching)
        self._shard, self._shards = shard, shards
        rule, reverse, shared = matching.rule, matching.reverse, ShardMetrics()
        self._parts = {
            number: ChannelShard(channel, rule, shard, shards, shared, reverse=reverse)
            for number, channel in self._channels.items()
        }
        self._compare_under(part.metric for part in self._parts.values())

    def rehearse(self) -> None:
        """Match frames of no stream, so that what is made at its first use is made."""
        dimensions = next(iter(self._places)).projection.shape[1]
        frames = np.eye(3, dimensions, dtype=np.float32)
        matchers = self._new_matchers()
        for seen in self._compare(list(frames)):
            for metric, matcher in matchers.values():
                matcher.finish([matcher.push(seen[metric])] * self._shards)

    def new_stream(self, outlet: Outlet, first: int) -> ChannelStream:
        """Begin a stream with the frame of this number."""
        self._check_unchanged()
        rule = self._matching.rule
        return ShardStream(self._new_matchers, rule, self._shard, self._shards, first, outlet)

    def _new_matchers(self) -> dict[int, tuple[MapMetric, ShardMatcher]]:
        return {number: (part.metric, part.new_matcher()) for number, part in self._parts.items()}

    def sights(self, descriptors: Sequence[Descriptor | None]) -> Sights:
        """Yield what tells how each descriptor compares; None is a frame that was not seen."""
        for descriptor in descriptors:
            yield dict if descriptor is None else partial(self._compare_one, descriptor)

    def _compare_one(self, descriptor: Descriptor) -> Seen:
        return next(self._compare([descriptor]))
