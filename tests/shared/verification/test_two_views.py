"""Correspondences of two images, and those that fit one epipolar geometry."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.verification.extracting import extract
from placefield.verification.local_features import LocalFeatures
from placefield.verification.two_views import (
    Correspondences,
    correspondences,
    count_inliers,
    epipolar_inliers,
)

Picture = Callable[[int], NDArray[np.uint8]]


def test_correspondences_are_those_of_opencvs_matcher(picture: Picture) -> None:
    one = extract(picture(1), 200)
    other = extract(np.ascontiguousarray(picture(1)[10:, 15:]), 200)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    there, back = (
        matcher.knnMatch(a.astype(np.float32), b.astype(np.float32), k=2)
        for a, b in (
            (one.descriptors, other.descriptors),
            (other.descriptors, one.descriptors),
        )
    )
    expected = [
        (first.queryIdx, first.trainIdx)
        for first, second in there
        if first.distance < 0.85 * second.distance
        and back[first.trainIdx][0].trainIdx == first.queryIdx
    ]
    found = correspondences(one, other)
    assert len(expected) > 50
    np.testing.assert_array_equal(found.one, one.points[[pair[0] for pair in expected]])
    np.testing.assert_array_equal(found.other, other.points[[pair[1] for pair in expected]])


def test_inliers_are_the_points_of_one_scene(two_views: Callable[..., Correspondences]) -> None:
    found = two_views(np.eye(3), np.array([0.3, 0, 0.9]))
    inliers = epipolar_inliers(found, 0)
    assert inliers[45:].mean() > 0.8
    assert inliers[:45].mean() < 0.15
    np.testing.assert_array_equal(inliers, epipolar_inliers(found, 0))


def test_a_shifted_view_has_many_inliers_and_another_scene_few(picture: Picture) -> None:
    one, shifted, other = (
        extract(np.ascontiguousarray(pixels), 200)
        for pixels in (picture(1), picture(1)[8:, 12:], picture(2))
    )
    assert count_inliers(one, shifted, 0) > 60
    assert count_inliers(one, other, 0) < 15


def test_images_without_local_features_have_no_inliers(picture: Picture) -> None:
    none = LocalFeatures(np.empty((0, 2), np.float32), np.empty((0, 128), np.uint8))
    assert count_inliers(none, extract(picture(1), 50), 0) == 0


def test_points_at_one_spot_fit_nothing_and_raise_nothing() -> None:
    spot = np.zeros((20, 2))
    assert epipolar_inliers(Correspondences(spot, spot, np.arange(20)), 0).shape == (20,)
