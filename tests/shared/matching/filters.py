"""Filters of the places of a metric, for tests of their beliefs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.maps.map import MapChannel, MapMetric
from placefield.maps.topology import Topology, line_of
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield.matching.matcher import Matcher
from placefield.matching.sharding import ChannelShard

SCALES = [4, 7, 12]


def channel_of(metric: MapMetric, scales: Sequence[int] = SCALES) -> MapChannel:
    """A channel of one segment, at these scales."""
    count = len(metric.places)
    return MapChannel(
        fuzzifier=1.1,
        clusters=1,
        metric=metric,
        labels=np.ones(count, np.int32),
        segments=np.array([[0, count]], np.int32),
        scales=np.array(scales, np.int32),
        smallest=min(scales),
        curve=np.zeros((0, 2)),
    )


def filter_of(
    metric: MapMetric,
    lag: int = 20,
    *,
    tolerance: int = 3,
    topology: Topology | None = None,
) -> Matcher:
    """A filter of all places, which are the only shard."""
    matching = MatchingConfig(lag=lag, tolerance=tolerance)
    return ChannelShard(channel_of(metric), matching, topology=topology).new_matcher()


def topology_of(travelled: NDArray[np.float64]) -> Topology:
    """A line of places at these metres."""
    return replace(line_of(len(travelled)), travelled=travelled)


def posterior_of(candidate: Candidate, places: int) -> NDArray[np.float64]:
    """Of each place, (K,); 0 where it was left out."""
    posterior = np.zeros(places)
    if candidate.place != UNANSWERED:
        posterior[candidate.places] = candidate.evidence
    return posterior
