"""The relative pose of two cameras is that of the scene, with an honest covariance."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.verification.relative_pose import Camera, relative_pose, tangents_of
from placefield.verification.two_views import Correspondences

CAMERA = Camera(0.9)
TURNED = np.asarray(cv2.Rodrigues(np.array([0.02, 0.15, -0.01]))[0], np.float64)
POSITION = np.array([0.3, 0.02, 0.9])
DIRECTION = POSITION / np.linalg.norm(POSITION)

Views = Callable[..., Correspondences]
Array = NDArray[np.float64]


def test_the_pose_is_that_of_the_scene_although_three_in_ten_points_are_wrong(
    two_views: Views,
) -> None:
    found = relative_pose(two_views(TURNED, POSITION, noise=0.1), CAMERA, 0)
    assert found is not None
    angle = np.linalg.norm(cv2.Rodrigues(found.rotation @ TURNED.T)[0])
    assert np.degrees(angle) < 0.1
    assert np.degrees(np.arccos(found.direction @ DIRECTION)) < 1
    assert found.inliers[45:].all()
    assert found.inliers[:45].sum() <= 3


def test_errors_are_as_large_as_the_covariance_says(two_views: Views) -> None:
    consistency = []
    for seed in range(20):
        found = relative_pose(two_views(TURNED, POSITION, wrong=0.1, seed=seed), CAMERA, seed)
        assert found is not None
        turn = cv2.Rodrigues(TURNED @ found.rotation.T)[0].ravel()
        aside = tangents_of(found.direction).T @ (DIRECTION - found.direction)
        error = np.concatenate([turn, aside])
        consistency.append(error @ np.linalg.solve(found.covariance, error))
    assert 2.2 < np.median(consistency) < 8.7  # half and twice the median of χ² of 5 dimensions


def test_the_direction_is_unknown_where_the_camera_has_not_moved(two_views: Views) -> None:
    views = two_views(np.eye(3), np.zeros(3), wrong=0.0, noise=0.0)
    found = relative_pose(views, CAMERA, 0)
    assert found is not None
    deviations = np.degrees(np.sqrt(np.diag(found.covariance)))
    assert deviations[:3].max() < 0.1
    assert deviations[3:].min() > 90


def test_there_is_no_pose_of_few_points_or_of_points_at_random(two_views: Views) -> None:
    assert relative_pose(two_views(TURNED, POSITION, points=14), CAMERA, 0) is None
    assert relative_pose(two_views(TURNED, POSITION, points=40, wrong=1.0), CAMERA, 0) is None


def test_the_same_seed_gives_the_same_pose(two_views: Views) -> None:
    one, other = (relative_pose(two_views(TURNED, POSITION), CAMERA, 3) for _ in range(2))
    assert one is not None
    assert other is not None
    np.testing.assert_array_equal(one.rotation, other.rotation)
    np.testing.assert_array_equal(one.covariance, other.covariance)
