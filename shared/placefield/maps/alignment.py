"""Aligns a drive to the places of a reference: by the smoother, by poses or by number.

The smoother recognises the frames like those of a query, with the whole drive known. Its posterior
already includes the motion, so no best path through the places is computed: on real routes, a
monotone path through the posterior changed no place, and a path through the distances of single
frames was worse.

Georeferenced poses give the nearest place instead.
"""

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.fusion.fusion_stage import FusionStage
from placefield.maps.map import MapChannel, MapMetric
from placefield.maps.topology import Topology
from placefield.maps.traverse import NO_PLACE, Alignment
from placefield.matching.comparing import MetricPlaces
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.matching.sharding import ChannelShard

NEAR_M = 5.0
"""Metres within which a frame shows a place; about the accuracy of satellite positioning."""

Array = NDArray[np.float32]


def align_by_number(count: int) -> Alignment:
    """Align frame i to place i, for ``count`` frames."""
    return Alignment(np.arange(count, dtype=np.int32), np.ones(count, np.float32), "number")


def align_by_smoother(metric: MapMetric, topology: Topology, frames: Array) -> Alignment:
    """Align frames by their descriptors; the speed may vary, and stretches may be off the route.

    A frame shows a place if its smoothed match is known.

    Args:
        metric: the identity metric of the K places, with their looks if they have some.
        topology: of the places.
        frames: (M, N) float32, descriptors of the drive's frames, in the order of travel.
    """
    matching = MatchingConfig(exact=True)
    fusion = FusionStage(topology, matching)
    shard = ChannelShard(channel_without_segments(metric), matching, topology=topology)
    matcher = shard.new_matcher([WHOLE_DRIVE])
    for frame in MetricPlaces(metric, exact=True).compare(frames):
        matcher.update(frame)
    matches = [fusion.fuse([smoothed.candidate]) for smoothed in matcher.finish()]
    return Alignment(
        np.array([match.place if match.known else NO_PLACE for match in matches], np.int32),
        np.array([match.probability or 0.0 for match in matches], np.float32),
        "smoother",
    )


def align_by_poses(reference: NDArray[np.float64], frames: NDArray[np.float64]) -> Alignment:
    """Align frames by poses: each shows the nearest place within 5 m in about the same heading.

    A turn of 60° counts as 5 m.

    Args:
        reference: (K, 3) float64, x and y of the places in metres and yaw in radians, NaN where
            unknown.
        frames: (M, 3) float64, the poses of the drive's frames, in the same coordinate frame.
    """
    targets = np.flatnonzero(np.isfinite(reference).all(axis=1))
    queries = np.flatnonzero(np.isfinite(frames).all(axis=1))
    places = np.full(len(frames), NO_PLACE, np.int32)
    if len(targets) and len(queries):
        from scipy.spatial import KDTree  # takes a quarter of a second

        tree = KDTree(_with_heading(reference[targets]))
        distances, nearest = tree.query(_with_heading(frames[queries]))
        is_near = distances <= NEAR_M
        places[queries[is_near]] = targets[np.asarray(nearest)[is_near]]
    return Alignment(places, (places != NO_PLACE).astype(np.float32), "poses")


def _with_heading(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (n, 3) as points (n, 4) whose distance includes the turn: 60° count as 5 m."""
    x, y, yaw = poses.T
    return np.column_stack([x, y, NEAR_M * np.cos(yaw), NEAR_M * np.sin(yaw)])


def channel_without_segments(metric: MapMetric) -> MapChannel:
    """Return a channel without segments."""
    count = len(metric.places)
    labels, segments = np.zeros(count, np.int32), np.zeros((0, 2), np.int32)
    return MapChannel(1, 1, metric, labels, segments, np.ones(1, np.int32), 1, np.zeros((0, 2)))
