"""Cuts a channel's places into shards. Each may have its own worker, perhaps on another host."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from placefield.config import MatchingConfig, Rule
from placefield.errors import ConfigError
from placefield.maps.map import MapChannel, MapMetric
from placefield.maps.route_graph import check_rule
from placefield.maps.topology import Topology
from placefield.matching.ams import AmsMatcher
from placefield.matching.best_window import vicinity_of
from placefield.matching.comparing import SampledPlaces, has_lists
from placefield.matching.evidence import EvidenceMatcher
from placefield.matching.filter_matcher import (
    HALO,
    LEAST_PLACES,
    SAMPLED,
    FilterMatcher,
    WholeMap,
)
from placefield.matching.map_steps import step_lengths_of
from placefield.matching.matcher import Matcher, ReverseMatcher
from placefield.matching.motion import evenly_spaced
from placefield.matching.roads import roads_of
from placefield.matching.smoother import Smoother
from placefield.matching.sparse_matcher import SparseMatcher
from placefield.matching.window_matcher import MeanDistance, ShardPlaces, reach
from placefield.search.spread import Spread, spread_of

_WINDOW_RULES = {"evidence": EvidenceMatcher, "ams": AmsMatcher}


class MetricShards:
    """What the shards of several channels under one metric share. Each part is made once."""

    def __init__(self) -> None:
        self._cuts: dict[tuple[MapMetric, int, int], MapMetric] = {}
        self._spreads: dict[MapMetric, Spread] = {}
        self._sampled: dict[tuple[MapMetric, bool], SampledPlaces] = {}
        self._mean_distances: dict[MapMetric, MeanDistance] = {}

    def cut(self, metric: MapMetric, places: slice) -> MapMetric:
        """Return a metric with only these places; the metric itself if these are all."""
        if places == slice(0, len(metric.places)):
            return metric
        key = metric, places.start, places.stop
        if key not in self._cuts:
            self._cuts[key] = _cut(metric, places)
        return self._cuts[key]

    def spread(self, metric: MapMetric) -> Spread:
        """Return the spread of all places under a metric; without an index, this reads them."""
        if metric not in self._spreads:
            coarse = metric.coarse
            self._spreads[metric] = spread_of(metric.places) if coarse is None else coarse.spread
        return self._spreads[metric]

    def sampled(self, metric: MapMetric, *, reverse: bool) -> SampledPlaces:
        """Return a sample of places under a metric, in the order of travel; this reads them."""
        if (metric, reverse) not in self._sampled:
            places = np.arange(len(metric.places), dtype=np.int32)
            chosen = evenly_spaced(places[::-1] if reverse else places, SAMPLED)
            self._sampled[metric, reverse] = SampledPlaces(metric, chosen)
        return self._sampled[metric, reverse]

    def mean_distance(self, metric: MapMetric) -> MeanDistance:
        """Return the function for a frame's mean distance under a metric; this reads all places."""
        if metric not in self._mean_distances:
            self._mean_distances[metric] = MeanDistance(metric)
        return self._mean_distances[metric]


class ChannelShard:
    """One shard of a map's channel, shared by all streams. A whole channel is shard 0 of 1.

    Attributes:
        metric: the channel's, with only the places that frames are to be compared with.
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
        topology: Topology | None = None,
    ) -> None:
        """Prepare a shard. This may read all places, except for a whole channel under ``filter``.

        Args:
            channel: of the whole map.
            matching: the rule, and whether the vehicle travels the route in reverse: windows and
                steps then follow the places in reverse order.
            shard: index of the shard, from 0.
            shards: how many there are.
            shared: by the channels of a worker.
            topology: of the map; None: one route of unknown metres, whose places all differ.

        Raises:
            ConfigError: the map has too few places for so many shards, or links that the rule does
                not follow.
        """
        shared = shared or MetricShards()
        self._channel, self._matching = channel, matching
        metric, self._places = channel.metric, len(channel.metric.places)
        self._lengths_of_windows = window_lengths(channel, matching.rule)
        longest = max(self._lengths_of_windows)
        least = LEAST_PLACES if matching.rule == "filter" else longest
        self.own = shard_range(self._places, shard, shards, least)
        # From here on, shards and places are in the order of travel.
        self._number = shards - 1 - shard if matching.reverse else shard
        self._in_order = self._reordered(self.own)
        self._observed = self._in_order
        topology = topology or Topology.line(self._places)
        check_rule(matching.rule, len(topology.graph.names))
        if matching.rule == "filter":
            topology = topology.reversed() if matching.reverse else topology
            is_coarse = metric.coarse is not None and not matching.compares_exactly
            self._is_sparse = is_coarse and shards == 1 and has_lists(metric)
            self._whole = WholeMap(
                step_lengths_of(metric, topology, reverse=matching.reverse, mapped=self._is_sparse),
                shared.spread(metric) if shards > 1 else None,
                shared.sampled(metric, reverse=matching.reverse)
                if is_coarse or shards > 1
                else None,
                roads=roads_of(topology),
            )
            self._vicinity = vicinity_of(topology, matching.tolerance)
            first, last = self._in_order.start - HALO, self._in_order.stop + HALO
            self._observed = slice(max(first, 0), min(last, self._places))
        else:
            self._mean_distance = shared.mean_distance(metric)
            after = reach(longest, matching.lag)
            around = ShardPlaces.around(self._places, self._in_order, longest - 1, after)
            self._observed = around.observed
        self.metric = shared.cut(metric, self._reordered(self._observed))

    def _reordered(self, places: slice) -> slice:
        """Convert a range of places from the map's order to the order of travel, or back."""
        if not self._matching.reverse:
            return places
        return slice(self._places - places.stop, self._places - places.start)

    def new_matcher(self, lags: Sequence[int] | None = None) -> Matcher:
        """Return a matcher for a new stream; frames are compared under this shard's metric.

        Args:
            lags: frames that a frame waits for at most, or ``WHOLE_DRIVE``; None: as configured.
                The stream is smoothed with each.
        """
        if lags is None:
            lags = [self._matching.lag]
        matcher = self._filter(lags) if self._matching.rule == "filter" else self._windows(lags)
        return ReverseMatcher(matcher, self._places) if self._matching.reverse else matcher

    def _filter(self, lags: Sequence[int]) -> Matcher:
        whole = self._whole
        smoothers = [Smoother(whole.lengths, lag, self._vicinity, whole.roads) for lag in lags]
        make = SparseMatcher if self._is_sparse else FilterMatcher
        return make(whole, self._in_order, self._number, smoothers)

    def _windows(self, lags: Sequence[int]) -> Matcher:
        places = ShardPlaces(self._places, self._in_order, self._observed)
        make = _WINDOW_RULES[self._matching.rule]
        return make(self._lengths_of_windows, places, self.metric.unit, self._mean_distance, lags)


def window_lengths(channel: MapChannel, rule: Rule) -> list[int]:
    """Return the lengths of the windows that a rule compares, in frames.

    Those of ``evidence`` are the channel's scales. Those of ``ams`` are the smallest scale of all
    channels, and the channel's coarse scales, which are the larger ones, ascending.
    """
    scales: list[int] = channel.scales.tolist()
    if rule != "ams":
        return scales
    return [channel.smallest, *(scale for scale in scales if scale > channel.smallest)]


def shard_range(places: int, shard: int, shards: int, least: int) -> slice:
    """Return the places of a shard. All shards have about as many.

    Args:
        places: how many the map has.
        shard: index of the shard, from 0.
        shards: how many there are.
        least: how many places each shard must have if there are several. A window that ends in a
            shard, or a step that leads there, then begins in the shard before it at the earliest.

    Raises:
        ConfigError: a shard would have fewer places, or there is no such shard.
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
        coarse=None if coarse is None else replace(coarse, codes=coarse.codes[places], lists=None),
        looks=None if metric.looks is None else metric.looks.between(places.start, places.stop),
    )
