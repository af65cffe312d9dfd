"""A map's places cut into shards, each for a worker of its own, perhaps on another host."""

from dataclasses import replace

from placefield.config import Rule
from placefield.errors import ConfigError
from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.channel_matcher import filter_model
from placefield.matching.filter_step import REACH
from placefield.matching.place_filter import PlaceFilter
from placefield.matching.shard_matcher import FilterShard, ReverseShard, ShardMatcher
from placefield.matching.window_shards import EvidenceShard, LowestScoreShard, MeanDistance
from placefield.matching.windows import WindowSums
from placefield.metric.spread import Spread, spread_of

_WINDOW_RULES = {"evidence": EvidenceShard, "lowest-score": LowestScoreShard}


class ShardMetrics:
    """What the shards of several channels under one metric share, each made once."""

    def __init__(self) -> None:
        self._cuts: dict[tuple[MapMetric, int, int], MapMetric] = {}
        self._spreads: dict[MapMetric, Spread] = {}

    def cut(self, metric: MapMetric, places: slice) -> MapMetric:
        """Return a metric with these places alone."""
        key = metric, places.start, places.stop
        if key not in self._cuts:
            self._cuts[key] = _cut(metric, places)
        return self._cuts[key]

    def spread(self, metric: MapMetric) -> Spread:
        """Return how all places under a metric spread; without a coarse look, this reads them."""
        if metric not in self._spreads:
            coarse = metric.coarse
            self._spreads[metric] = spread_of(metric.places) if coarse is None else coarse.spread
        return self._spreads[metric]


class ChannelShard:
    """One shard of a map's channel: what all streams in it share.

    Attributes:
        metric: the channel's, with those places alone that frames are to be compared with.
        own: the shard's places in the map.
    """

    metric: MapMetric
    own: slice

    def __init__(
        self,
        channel: MapChannel,
        rule: Rule,
        shard: int,
        shards: int,
        metrics: ShardMetrics,
        *,
        reverse: bool = False,
    ) -> None:
        """Prepare a shard; this reads all places of the map once.

        Args:
            channel: of the whole map.
            rule: how candidates are made.
            shard: which of them, from 0.
            shards: how many there are.
            metrics: of all channels of a worker.
            reverse: whether the route is driven the other way, see ``matcher_of``.

        Raises:
            ConfigError: the map has too few places for so many shards.
        """
        self._channel, self._rule, self._reverse = channel, rule, reverse
        metric, self._places = channel.metric, len(channel.metric.places)
        longest = int(channel.scales.max())
        self.own = shard_range(self._places, shard, shards, max(longest, REACH))
        # In the order in which they are driven past.
        self._number = shards - 1 - shard if reverse else shard
        self._driven = self._turned(self.own)
        self._seen = self._driven
        if rule == "filter":
            self._spread = metrics.spread(metric)
        else:
            self._mean_distance = MeanDistance(metric)
            self._seen = slice(max(self._driven.start - longest + 1, 0), self._driven.stop)
        self.metric = metrics.cut(metric, self._turned(self._seen))

    def _turned(self, places: slice) -> slice:
        """Return where places are in the map that are so in driven order, or the reverse."""
        if not self._reverse:
            return places
        return slice(self._places - places.stop, self._places - places.start)

    def new_matcher(self) -> ShardMatcher:
        """Return a matcher for a new stream; frames are compared under this shard's metric."""
        matcher = self._filter() if self._rule == "filter" else self._windows()
        return ReverseShard(matcher, self._places) if self._reverse else matcher

    def _filter(self) -> ShardMatcher:
        model = filter_model(self._channel, reverse=self._reverse)
        place_filter = PlaceFilter(*model, self._driven)
        return FilterShard(place_filter, self._spread, self._driven.start, self._number)

    def _windows(self) -> ShardMatcher:
        scales = self._channel.scales.tolist()
        windows = WindowSums(scales, len(self.metric.places), self.metric.unit)
        make = _WINDOW_RULES[self._rule]
        return make(windows, self._mean_distance, self._seen, self._driven)


def shard_range(places: int, shard: int, shards: int, least: int) -> slice:
    """Return which places of a map of so many are a shard's: all have about as many.

    Args:
        places: of the map.
        shard: which, from 0.
        shards: how many there are.
        least: how many places each must have, if there are several; the longest scale, so that a
            window that ends in a shard begins in the one before it at the earliest.

    Raises:
        ConfigError: they have fewer, or there is no such shard.
    """
    if not 0 <= shard < shards:
        raise ConfigError(f"shard {shard} of {shards}: they are numbered from 0 to {shards - 1}")
    if shards > 1 and places // shards < least:
        most = max(places // least, 1)
        raise ConfigError(
            f"{shards} shards of {places} places: each needs {least}, the longest scale; "
            f"take {most} at most"
        )
    return slice(places * shard // shards, places * (shard + 1) // shards)


def _cut(metric: MapMetric, places: slice) -> MapMetric:
    coarse = metric.coarse
    return replace(
        metric,
        places=metric.places[places],
        squares=metric.squares[places],
        steps=metric.steps[:, places],
        coarse=None if coarse is None else replace(coarse, codes=coarse.codes[places]),
    )
