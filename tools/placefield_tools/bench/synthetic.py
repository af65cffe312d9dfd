"""Maps of synthetic descriptors, without images."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config, FeatureConfig
from placefield.features.descriptors import DescriptorModel
from placefield.maps.manifest import TraverseRecord
from placefield.maps.map import Map, MapChannel, MapMetric, Places
from placefield.maps.map_metrics import learned_metric
from placefield_tools.bench.random_walks import near_identity

CHANNELS = 4
SCALES = (4, 6, 8, 11, 14, 18, 22, 27, 33, 39, 45, 52)
"""Of every channel, frames: as many, and as long, as the paper's."""

_LEARNED_RANK = 0.66
"""Rows of a learned projection over its columns: 193 to 201 of 300 on Gardens Point."""

Array = NDArray[np.float32]


def made_map(walk: Array, *, coarse: bool = False) -> Map:
    """Make a map of a walk (K, N), whose channels have metrics of their own."""
    return _map_of([made_channel(walk, number, coarse=coarse) for number in range(CHANNELS)])


def map_of_one_metric(metric: MapMetric) -> Map:
    """Make a map whose channels share a metric."""
    return _map_of([_channel_under(metric)] * CHANNELS)


def _map_of(channels: Sequence[MapChannel]) -> Map:
    metric = channels[0].metric
    count, dimensions = len(metric.places), metric.projection.shape[1]
    identity = np.eye(dimensions, dtype=np.float32)
    nothing = np.zeros(0, np.uint8)
    return Map(
        preset=None,
        seed=0,
        features=FeatureConfig(kind="gist", dimensions=dimensions),
        scales=Config().scales,
        metric=Config().metric,
        traverses=(TraverseRecord(name="a walk", frames=count),),
        pose_frame=None,
        model=DescriptorModel("gist", True, identity[0], identity[0], identity, variance_kept=1.0),
        places=Places(
            np.arange(count),
            np.empty((0, 3)),
            np.empty(0),
            np.arange(count, dtype=np.int32),
            nothing,
            np.zeros(count, np.int64),
        ),
        channels=tuple(channels),
    )


def made_channel(walk: Array, number: int, *, coarse: bool = False) -> MapChannel:
    """Make a channel of a walk (K, N), with a metric as if it had been learned."""
    dimensions = walk.shape[1]
    projection = near_identity(dimensions, seed=number)[: round(_LEARNED_RANK * dimensions)]
    return _channel_under(learned_metric(projection, walk, coarse=coarse))


def _channel_under(metric: MapMetric) -> MapChannel:
    """Make a channel of one segment."""
    count = len(metric.places)
    labels, segments = np.ones(count, np.int32), np.array([[0, count]], np.int32)
    scales = np.array(SCALES, np.int32)
    return MapChannel(1.1, 1, metric, labels, segments, scales, SCALES[0], np.zeros((0, 2)))
