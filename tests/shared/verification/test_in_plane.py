"""A relative pose in the plane of a vehicle, and its distance by odometry."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.verification.in_plane import distance_of, turn_of
from placefield.verification.plane_pose import PlanePose
from placefield.verification.relative_pose import Camera, RelativePose, relative_pose
from placefield.verification.two_views import Correspondences

CAMERA = Camera(0.9)

Array = NDArray[np.float64]
Views = Callable[..., Correspondences]


def camera_of(x: float, y: float, yaw: float) -> tuple[Array, Array]:
    """Return the rotation and the position of the camera of a vehicle, in those of the first."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    ahead, right = np.array([-sine, 0, cosine]), np.array([cosine, 0, sine])
    return np.column_stack([right, [0, 1, 0], ahead]), np.array([-y, 0, x])


def seen(views: Views, *pose: float, seed: int = 0) -> tuple[Correspondences, RelativePose]:
    found = views(*camera_of(*pose), wrong=0.2, noise=0.3, seed=seed)
    relative = relative_pose(found, CAMERA, 0)
    assert relative is not None
    return found, relative


def test_bearing_and_yaw_are_those_of_the_vehicle(two_views: Views) -> None:
    turn = turn_of(seen(two_views, 0.8, 0.4, -0.1)[1])
    assert turn.bearing == pytest.approx(np.arctan2(0.4, 0.8), abs=0.03)
    assert turn.yaw == pytest.approx(-0.1, abs=0.003)
    deviations = np.sqrt(np.diag(turn.covariance))
    assert (deviations < (0.02, 0.002)).all()


def test_the_distance_is_in_the_metres_of_the_odometry(two_views: Views) -> None:
    query, neighbour = seen(two_views, 0.8, 0.4, -0.1), seen(two_views, 0.5, 0.0, 0.02)
    # the odometer's unit: the neighbour is 2 m away, so that all is four times as large
    distance = distance_of(query, neighbour, 2.0, CAMERA)
    assert distance is not None
    assert distance.metres == pytest.approx(4 * np.hypot(0.8, 0.4), rel=0.1)
    assert 0.05 <= distance.deviation / distance.metres < 0.15


def test_x_and_y_are_as_far_off_as_their_covariance_says(two_views: Views) -> None:
    query, neighbour = seen(two_views, 0.8, 0.4, -0.1), seen(two_views, 0.5, 0.0, 0.02)
    found = PlanePose(turn_of(query[1]), distance_of(query, neighbour, 0.5, CAMERA)).cartesian()
    assert found is not None
    error = found[0] - [0.8, 0.4, -0.1]
    assert np.abs(error[:2]).max() < 0.1
    assert error @ np.linalg.solve(found[1], error) < 12.8  # χ² of 3 dimensions, 99.5 %


def test_there_is_no_distance_without_shared_points(two_views: Views) -> None:
    query, (found, pose) = seen(two_views, 0.8, 0.4, -0.1), seen(two_views, 0.5, 0.0, 0.02)
    other = found._replace(numbers=found.numbers + 1000), pose
    assert distance_of(query, other, 2.0, CAMERA) is None
