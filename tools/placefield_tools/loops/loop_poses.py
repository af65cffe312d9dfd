"""The relative poses of the frames that close a loop, by their local features."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.verification.in_plane import Distance, Turn, distance_of, turn_of
from placefield.verification.relative_pose import Camera, RelativePose, relative_pose
from placefield.verification.two_views import Correspondences, correspondences
from placefield_tools.loops.finding import DriveFrame

_SEED = 0
_CALIBRATION = 0.02  # radians, the deviation of an angle by errors of the camera's calibration
_NEXT = 10  # frames after a place among which a neighbour is looked for


class LoopPose(NamedTuple):
    """The pose of a frame relative to the earlier frame that it shows.

    Attributes:
        turn: the bearing and the yaw.
        distance: between the two; None without odometry, or if too few points have depths.
    """

    turn: Turn
    distance: Distance | None

    def edge(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Return x, y and yaw, (3,), and their covariance (3, 3); None without a distance."""
        if self.distance is None:
            return None
        metres = self.distance.metres
        x, y = metres * np.cos(self.turn.bearing), metres * np.sin(self.turn.bearing)
        covariance = np.zeros((3, 3))  # of distance, bearing and yaw
        covariance[0, 0] = self.distance.deviation**2
        covariance[1:, 1:] = self.turn.covariance
        jacobian = np.array([[x / metres, -y, 0], [y / metres, x, 0], [0, 0, 1]])
        return np.array([x, y, self.turn.yaw]), jacobian @ covariance @ jacobian.T


def loop_pose(
    frames: Sequence[DriveFrame], place: int, number: int, camera: Camera
) -> LoopPose | None:
    """Return the pose of frame ``number`` relative to frame ``place``.

    Args:
        frames: of the drive.
        place: position of the earlier frame.
        number: position of the later frame.
        camera: that took the frames.

    Returns:
        The pose; None if the images have too few correspondences.
    """
    query = _pair(frames[place], frames[number], camera)
    if query is None:
        return None
    turn = turn_of(query[1])
    turn = turn._replace(covariance=turn.covariance + _CALIBRATION**2 * np.eye(2))
    return LoopPose(turn, _distance(frames, place, query, camera))


def _pair(
    one: DriveFrame, other: DriveFrame, camera: Camera
) -> tuple[Correspondences, RelativePose] | None:
    if one.local_features is None or other.local_features is None:
        return None
    found = correspondences(one.local_features, other.local_features)
    pose = relative_pose(found, camera, _SEED)
    return None if pose is None else (found, pose)


def _distance(
    frames: Sequence[DriveFrame],
    place: int,
    query: tuple[Correspondences, RelativePose],
    camera: Camera,
) -> Distance | None:
    """Return the distance of a query from a place, by the next frame that odometry has moved on."""
    start = frames[place].odometry_m
    if start is None:
        return None
    for later in frames[place + 1 : place + 1 + _NEXT]:
        if later.odometry_m is not None and later.odometry_m > start:
            neighbour = _pair(frames[place], later, camera)
            if neighbour is None:
                return None
            return distance_of(query, neighbour, later.odometry_m - start, camera)
    return None
