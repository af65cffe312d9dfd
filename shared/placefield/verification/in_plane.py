"""A relative pose of two cameras as the motion of a vehicle in the plane.

The camera looks ahead and is upright: its z is the vehicle's x, and its x is opposite to the
vehicle's y.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.verification.relative_pose import (
    Camera,
    RelativePose,
    depths,
    moved,
    rays_of,
    tangents_of,
)
from placefield.verification.two_views import Correspondences

_DIFFERENCE = 1e-6  # for derivatives
_LEAST = 8  # points that both pairs of images have
_MEDIAN_TO_DEVIATION = 1.4826
_ODOMETRY = 0.05  # relative deviation of an odometer's reading

Array = NDArray[np.float64]


class Turn(NamedTuple):
    """How a second view is turned against the first, and where it lies, without a distance.

    Attributes:
        bearing: of the second camera from the first, radians counterclockwise from ahead.
        yaw: of the second camera against the first, radians counterclockwise.
        covariance: (2, 2) of the two, radians².
    """

    bearing: float
    yaw: float
    covariance: Array


class Distance(NamedTuple):
    """A distance in metres, and its standard deviation."""

    metres: float
    deviation: float


def turn_of(pose: RelativePose) -> Turn:
    """Return the bearing and the yaw of a relative pose."""
    angles, tangents = _angles(pose.rotation, pose.direction), tangents_of(pose.direction)
    changes = [
        _angles(*moved(pose.rotation, pose.direction, tangents, step)) - angles
        for step in _DIFFERENCE * np.eye(5)
    ]
    jacobian = np.angle(np.exp(1j * np.column_stack(changes))) / _DIFFERENCE
    bearing, yaw = angles.tolist()
    return Turn(bearing, yaw, jacobian @ pose.covariance @ jacobian.T)


def distance_of(
    query: tuple[Correspondences, RelativePose],
    neighbour: tuple[Correspondences, RelativePose],
    metres: float,
    camera: Camera,
) -> Distance | None:
    """Return the distance of a query from a place, by the odometry between place and neighbour.

    A point that the place shares with both has a depth by each pair of images. Their ratio is that
    of the two distances; the median of all points counts.

    Args:
        query: correspondences and relative pose of the place and the query.
        neighbour: those of the place and its neighbour.
        metres: from the place to its neighbour, above 0.
        camera: that took all images.

    Returns:
        The distance; None if fewer than 8 points have depths.
    """
    of_query, of_neighbour = (_depths(*pair, camera) for pair in (query, neighbour))
    shared = sorted(of_query.keys() & of_neighbour.keys())
    if len(shared) < _LEAST:
        return None
    logs = np.log([of_neighbour[point] / of_query[point] for point in shared])
    middle = float(np.median(logs))
    spread = _MEDIAN_TO_DEVIATION * float(np.median(np.abs(logs - middle)))
    distance = metres * float(np.exp(middle))
    return Distance(distance, distance * float(np.hypot(spread / np.sqrt(len(logs)), _ODOMETRY)))


def _angles(rotation: Array, direction: Array) -> Array:
    ahead = rotation[:, 2]
    return np.array(
        [np.arctan2(-direction[0], direction[2]), np.arctan2(-ahead[0], ahead[2])], np.float64
    )


def _depths(found: Correspondences, pose: RelativePose, camera: Camera) -> dict[int, float]:
    """Return the depths of a pair's points by their number in the first image, in baselines."""
    one, other = (rays_of(points, camera)[pose.inliers] for points in (found.one, found.other))
    first, second = depths(pose.direction, one, other @ pose.rotation.T)
    numbers = found.numbers[pose.inliers]
    seen = (first > 0) & (second > 0)
    return dict(zip(numbers[seen].tolist(), first[seen].tolist(), strict=True))
