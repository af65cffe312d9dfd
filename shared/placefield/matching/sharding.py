"""A channel's places cut into shards, each for a worker of its own, perhaps on another host."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig, Rule
from placefield.errors import ConfigError
from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.best_window import twins_in
from placefield.matching.comparing import SomePlaces
from placefield.matching.evidence import EvidenceMatcher
from placefield.matching.filter_matcher import (
    HALO,
    LEAST_PLACES,
    SOME,
    FilterMatcher,
    lengths_of,
)
from placefield.matching.lowest_score import LowestScoreMatcher
from placefield.matching.matcher import Matcher, ReverseMatcher
from placefield.matching.motion import evenly_spaced
from placefield.matching.odometry import Road, road
from placefield.matching.smoother import Smoother
from placefield.matching.window_matcher import MeanDistance, ShardPlaces, reach
from placefield.search.spread import Spread, spread_of

_WINDOW_RULES = {"evidence": EvidenceMatcher, "lowest-score": LowestScoreMatcher}


class MetricShards:
    """What the shards of several channels under one metric share, each made once."""

    def __init__(self) -> None:
        self._cuts: dict[tuple[MapMetric, int, int], MapMetric] = {}
        self._spreads: dict[MapMetric, Spread] = {}
        self._some: dict[tuple[MapMetric, bool], SomePlaces] = {}
        self._mean_distances: dict[MapMetric, MeanDistance] = {}

    def cut(self, metric: MapMetric, places: slice) -> MapMetric:
        """Return a metric with these places alone; the metric itself if these are all."""
        if places == slice(0, len(metric.places)):
            return metric
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

    def some(self, metric: MapMetric, *, reverse: bool) -> SomePlaces:
        """Return places under a metric that stand for all, as they are driven; this reads them."""
        if (metric, reverse) not in self._some:
            places = np.arange(len(metric.places), dtype=np.int32)
            chosen = evenly_spaced(places[::-1] if reverse else places, SOME)
            self._some[metric, reverse] = SomePlaces(metric, chosen)
        return self._some[metric, reverse]

    def mean_distance(self, metric: MapMetric) -> MeanDistance:
        """Return what tells a frame's mean distance under a metric; this reads all places."""
        if metric not in self._mean_distances:
            self._mean_distances[metric] = MeanDistance(metric)
        return self._mean_distances[metric]


class ChannelShard:
    """One shard of a map's channel: what all streams in it share. A whole channel is 0 of 1.

    Attributes:
        metric: the channel's, with those places alone that frames are to be compared with.
        own: the shard's places in the map.
    """

    metric: MapMetric
    own: slice

    def __init__(
        self,
        channel: MapChannel,
        matching: MatchingConfig,
        shard: int = 0,
        shards: int = 1,
        shared: MetricShards | None = None,
        travelled: NDArray[np.float64] | None = None,
        same: NDArray[np.int32] | None = None,
    ) -> None:
        """Prepare a shard; but for a whole channel under ``filter``, this may read all places.

        Args:
            channel: of the whole map.
            matching: the rule, and whether the route is driven the other way: windows and steps
                then follow the places in reverse order.
            shard: which of them, from 0.
            shards: how many there are.
            shared: with the other channels of a worker.
            travelled: (K,) metres up to each place of the map; None or empty: unknown.
            same: (K,) int32, which place of the map each is the same as; None: all differ.

        Raises:
            ConfigError: the map has too few places for so many shards.
        """
        shared = shared or MetricShards()
        self._channel, self._matching = channel, matching
        metric, self._places = channel.metric, len(channel.metric.places)
        self._windows_of = window_lengths(channel, matching.rule)
        longest = max(self._windows_of)
        least = LEAST_PLACES if matching.rule == "filter" else longest
        self.own = shard_range(self._places, shard, shards, least)
        # In the order in which they are driven past.
        self._number = shards - 1 - shard if matching.reverse else shard
        self._driven = self._turned(self.own)
        self._observed = self._driven
        self._same = self._turned_twins(same)
        if matching.rule == "filter":
            self._lengths = lengths_of(metric, reverse=matching.reverse)
            self._spread = shared.spread(metric) if shards > 1 else None
            sees_all = shards == 1 and (metric.coarse is None or matching.compares_exactly)
            self._some = None if sees_all else shared.some(metric, reverse=matching.reverse)
            self._road = self._road_along(travelled)
            first, last = self._driven.start - HALO, self._driven.stop + HALO
            self._observed = slice(max(first, 0), min(last, self._places))
        else:
            self._mean_distance = shared.mean_distance(metric)
            ahead = reach(longest, matching.lag)
            around = ShardPlaces.around(self._places, self._driven, longest - 1, ahead)
            self._observed = around.observed
        self.metric = shared.cut(metric, self._turned(self._observed))

    def _turned(self, places: slice) -> slice:
        """Return where places are in the map that are so in driven order, or the reverse."""
        if not self._matching.reverse:
            return places
        return slice(self._places - places.stop, self._places - places.start)

    def _turned_twins(self, same: NDArray[np.int32] | None) -> NDArray[np.int32] | None:
        """Return which places are the same, as they are driven; None where all differ."""
        twins = None if same is None else twins_in(same)
        if twins is None or not self._matching.reverse:
            return twins
        return np.int32(self._places - 1) - twins[::-1]

    def _road_along(self, travelled: NDArray[np.float64] | None) -> Road | None:
        """Return the way along the places, as they are driven; None where nobody knows."""
        if travelled is None or not len(travelled):
            return None
        return road(travelled[-1] - travelled[::-1] if self._matching.reverse else travelled)

    def new_matcher(self, lag: int | None = None) -> Matcher:
        """Return a matcher for a new stream; frames are compared under this shard's metric.

        Args:
            lag: frames that one waits for at most, or ``WHOLE_DRIVE``; None: as configured.
        """
        if lag is None:
            lag = self._matching.lag
        matcher = self._filter(lag) if self._matching.rule == "filter" else self._windows(lag)
        return ReverseMatcher(matcher, self._places) if self._matching.reverse else matcher

    def _filter(self, lag: int) -> Matcher:
        tolerance = self._matching.tolerance
        smoother = Smoother(self._lengths, lag, tolerance, self._road, self._same)
        return FilterMatcher(
            self._lengths,
            self._driven,
            self._number,
            smoother,
            self._spread,
            self._road,
            self._some,
        )

    def _windows(self, lag: int) -> Matcher:
        places = ShardPlaces(self._places, self._driven, self._observed)
        make = _WINDOW_RULES[self._matching.rule]
        return make(self._windows_of, places, self.metric.unit, self._mean_distance, lag)


def window_lengths(channel: MapChannel, rule: Rule) -> list[int]:
    """Return the lengths of the windows that a rule compares, frames.

    Those of ``evidence`` are the channel's scales. Those of ``lowest-score`` are the smallest scale
    of all channels and, ascending, the channel's larger ones: its coarse scales.
    """
    scales: list[int] = channel.scales.tolist()
    if rule != "lowest-score":
        return scales
    return [channel.smallest, *(scale for scale in scales if scale > channel.smallest)]


def shard_range(places: int, shard: int, shards: int, least: int) -> slice:
    """Return which places of a map of so many are a shard's: all have about as many.

    Args:
        places: of the map.
        shard: which, from 0.
        shards: how many there are.
        least: how many places each must have, if there are several, so that a window that ends in
            a shard, or a step that leads there, begins in the one before it at the earliest.

    Raises:
        ConfigError: they have fewer, or there is no such shard.
    """
    if not 0 <= shard < shards:
        raise ConfigError(f"shard {shard} of {shards}: they are numbered from 0 to {shards - 1}")
    if shards > 1 and places // shards < least:
        most = max(places // least, 1)
        raise ConfigError(
            f"{shards} shards of {places} places: each needs {least}; take {most} at most"
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
