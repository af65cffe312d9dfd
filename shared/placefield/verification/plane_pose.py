"""The pose of a frame relative to a place in the plane, in metres if odometry gives the scale."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.verification.in_plane import Distance, Turn, distance_of, turn_of
from placefield.verification.local_features import LocalFeatures
from placefield.verification.relative_pose import Camera, RelativePose, relative_pose
from placefield.verification.two_views import Correspondences, correspondences

_CALIBRATION = 0.02  # radians, the deviation of an angle by errors of the camera's calibration

Array = NDArray[np.float64]

Related = tuple[Correspondences, RelativePose]
"""The correspondences of two views, and the pose of the second relative to the first."""


class Neighbour(NamedTuple):
    """A view that is known to be so many metres, above 0, from a place."""

    view: LocalFeatures
    metres: float


class PlanePose(NamedTuple):
    """The pose of a frame relative to a place.

    Attributes:
        turn: the bearing and the yaw.
        distance: None without a neighbour, or if too few points have depths.
    """

    turn: Turn
    distance: Distance | None

    def cartesian(self) -> tuple[Array, Array] | None:
        """Return x, y and yaw, (3,), and their covariance, (3, 3); None without a distance."""
        if self.distance is None:
            return None
        metres = self.distance.metres
        x, y = metres * np.cos(self.turn.bearing), metres * np.sin(self.turn.bearing)
        covariance = np.zeros((3, 3))  # of distance, bearing and yaw
        covariance[0, 0] = self.distance.deviation**2
        covariance[1:, 1:] = self.turn.covariance
        jacobian = np.array([[x / metres, -y, 0], [y / metres, x, 0], [0, 0, 1]])
        return np.array([x, y, self.turn.yaw]), jacobian @ covariance @ jacobian.T


def plane_pose(
    place: LocalFeatures,
    query: LocalFeatures,
    neighbour: Neighbour | None,
    camera: Camera,
    seed: int,
) -> PlanePose | None:
    """Return the pose of a frame relative to a place; None if too few correspondences fit one.

    Args:
        place: local features of the place.
        query: those of the frame.
        neighbour: a view from near the place; None: the scale is not known.
        camera: that took all of them.
        seed: of RANSAC.
    """
    pair = related(place, query, camera, seed)
    if pair is None:
        return None
    turn = turn_of(pair[1])
    turn = turn._replace(covariance=turn.covariance + _CALIBRATION**2 * np.eye(2))
    return PlanePose(turn, scaled(pair, place, neighbour, camera, seed))


def scaled(
    pair: Related, place: LocalFeatures, neighbour: Neighbour | None, camera: Camera, seed: int
) -> Distance | None:
    """Return the distance of a frame from a place by a neighbour of the place; None if unknown.

    Args:
        pair: the place and the frame.
        place: local features of the place.
        neighbour: a view from near the place; None: the scale is not known.
        camera: that took all of them.
        seed: of RANSAC.
    """
    beside = None if neighbour is None else related(place, neighbour.view, camera, seed)
    if neighbour is None or beside is None:
        return None
    return distance_of(pair, beside, neighbour.metres, camera)


def related(one: LocalFeatures, other: LocalFeatures, camera: Camera, seed: int) -> Related | None:
    """Return the correspondences and the relative pose of two views; None if there is no pose."""
    found = correspondences(one, other)
    pose = relative_pose(found, camera, seed)
    return None if pose is None else (found, pose)
