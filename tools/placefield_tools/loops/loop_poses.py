"""The relative poses of the frames that close a loop, by their local features."""

from collections.abc import Sequence

from placefield.verification.plane_pose import Neighbour, PlanePose, plane_pose
from placefield.verification.relative_pose import Camera
from placefield_tools.loops.finding import DriveFrame

_SEED = 0
_NEXT = 10  # frames after a place among which a neighbour is looked for


def loop_pose(
    frames: Sequence[DriveFrame], place: int, number: int, camera: Camera
) -> PlanePose | None:
    """Return the pose of frame ``number`` relative to frame ``place``.

    Args:
        frames: of the drive.
        place: position of the earlier frame.
        number: position of the later frame.
        camera: that took the frames.

    Returns:
        The pose; None if the images have too few correspondences.
    """
    view, query = frames[place].local_features, frames[number].local_features
    if view is None or query is None:
        return None
    return plane_pose(view, query, _neighbour(frames, place), camera, _SEED)


def _neighbour(frames: Sequence[DriveFrame], place: int) -> Neighbour | None:
    """Return the next frame that odometry has moved on, with its distance."""
    start = frames[place].odometry_m
    if start is None:
        return None
    for later in frames[place + 1 : place + 1 + _NEXT]:
        is_ahead = later.odometry_m is not None and later.odometry_m > start
        if is_ahead and later.local_features is not None:
            return Neighbour(later.local_features, (later.odometry_m or 0) - start)
    return None
