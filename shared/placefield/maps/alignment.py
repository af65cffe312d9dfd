"""Which place of the reference each frame of another drive shows.

The frames are matched as those of a query are, with the whole drive known: the smoother. Its
posterior holds the motion already, so that its places need no best path on top of it: on real
routes a monotone path through the posterior changed no place, and one through the distances of
single frames was worse.

Where the poses of both are on earth, the nearest place will do.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from placefield.config import MatchingConfig
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.maps.metrics import identity_metric
from placefield.maps.traverse import NO_PLACE, Alignment
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.matching.revisits import channel_without_segments, same_places

NEAR_M = 5.0
"""A place further from a frame is not the one that it shows: satellites tell as well as that."""

Array = NDArray[np.float32]


def align_by_number(count: int) -> Alignment:
    """Align frame i of so many to place i."""
    return Alignment(np.arange(count, dtype=np.int32), np.ones(count, np.float32), "number")


def align_by_smoother(reference: Array, frames: Array) -> Alignment:
    """Align frames by what they show, at any speed, with stops and stretches off the route.

    A frame shows a place if its match is known, as that of a query is.

    Args:
        reference: (K, N) float32, descriptors of the places, in the order of the drive.
        frames: (M, N) float32, descriptors of the drive's frames, in their order.
    """
    matching, same = MatchingConfig(), same_places(reference)
    channels = ChannelStage(
        {0: channel_without_segments(identity_metric(reference))}, matching, same=same
    )
    stream = FusedStream(channels, FusionStage(same, matching), WHOLE_DRIVE)
    for frame in frames:
        stream.update(next(channels.compare([frame])))
    matches = [smoothed.match for smoothed in stream.finish()]
    return Alignment(
        np.array([match.place if match.known else NO_PLACE for match in matches], np.int32),
        np.array([match.probability or 0.0 for match in matches], np.float32),
        "smoother",
    )


def align_by_poses(reference: NDArray[np.float64], frames: NDArray[np.float64]) -> Alignment:
    """Align frames by poses: each shows the nearest place at most 5 m off that looks its way.

    A turn of 60° counts as much as 5 m.

    Args:
        reference: (K, 3) float64, x and y of the places in metres and yaw in radians, NaN where
            nobody knows.
        frames: (M, 3) float64, those of the drive's frames, in the same frame of reference.
    """
    known = np.flatnonzero(np.isfinite(reference).all(axis=1))
    asked = np.flatnonzero(np.isfinite(frames).all(axis=1))
    places = np.full(len(frames), NO_PLACE, np.int32)
    if len(known) and len(asked):
        away, nearest = KDTree(_headed(reference[known])).query(_headed(frames[asked]))
        is_near = away <= NEAR_M
        places[asked[is_near]] = known[np.asarray(nearest)[is_near]]
    return Alignment(places, (places != NO_PLACE).astype(np.float32), "poses")


def _headed(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (n, 4) that are as far apart as poses (n, 3) are, a turn of 60° being 5 m."""
    x, y, yaw = poses.T
    return np.column_stack([x, y, NEAR_M * np.cos(yaw), NEAR_M * np.sin(yaw)])
