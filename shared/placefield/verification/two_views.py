"""Two images as views of one scene: correspondences, and how many fit one epipolar geometry."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.verification.local_features import SIDE, LocalFeatures

_RATIO = 0.85  # of the nearest descriptor's distance and the second nearest one's, at most
_CONFIDENCE = 0.999  # that the best geometry is found, if there is one
_TRIALS = 2000

LEAST = 8
"""Correspondences: fewer always fit a fundamental matrix."""

TOLERANCE = 1.5
"""Pixels from the epipolar line, in an image of the longest side ``SIDE``."""


class Correspondences(NamedTuple):
    """Points of two images that look alike.

    Attributes:
        one: (m, 2) float64, points of the first image, see ``LocalFeatures``.
        other: (m, 2) float64, those of the second image.
        numbers: (m,) int64, the numbers of the points in the first image.
    """

    one: NDArray[np.float64]
    other: NDArray[np.float64]
    numbers: NDArray[np.int64]


def correspondences(one: LocalFeatures, other: LocalFeatures) -> Correspondences:
    """Return the points whose descriptors are each other's nearest, and much nearer than others.

    The ratio of the distances to the nearest and to the second nearest descriptor is at most .85
    (Lowe 2004).
    """
    if min(len(one.points), len(other.points)) < 2:
        return Correspondences(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, np.int64))
    # Less 128 their distances stay, and products are whole numbers below 2²⁴: exact in any order.
    first, second = (each.descriptors.astype(np.float32) - 128 for each in (one, other))
    products = first @ second.T
    distances = (first**2).sum(axis=1)[:, None] + (second**2).sum(axis=1) - 2 * products
    nearest = distances.argmin(axis=1)
    rows = np.arange(len(first))
    is_mutual = distances.argmin(axis=0)[nearest] == rows
    two = np.partition(distances, 1, axis=1)[:, :2]
    kept = is_mutual & (two[:, 0] < _RATIO**2 * two[:, 1])
    return Correspondences(
        one.points[kept].astype(np.float64),
        other.points[nearest[kept]].astype(np.float64),
        np.flatnonzero(kept),
    )


def epipolar_inliers(found: Correspondences, seed: int) -> NDArray[np.bool_]:
    """Return which correspondences fit the fundamental matrix that most of them fit, (m,) bool.

    It is found by MAGSAC++ (Barath et al. 2020); the same seed gives the same result.
    """
    none = np.zeros(len(found.one), np.bool_)
    if len(none) < LEAST:
        return none
    settings = ransac_settings(seed, TOLERANCE)
    try:
        _, mask = cv2.findFundamentalMat(SIDE * found.one, SIDE * found.other, settings)
    except cv2.error:  # it found no model at all
        return none
    return none if mask is None else mask.ravel().astype(np.bool_)


def count_inliers(one: LocalFeatures, other: LocalFeatures, seed: int) -> int:
    """Return how many correspondences of two images fit one epipolar geometry."""
    return int(epipolar_inliers(correspondences(one, other), seed).sum())


def ransac_settings(seed: int, tolerance: float) -> cv2.UsacParams:
    """Return the settings of MAGSAC++ in OpenCV, for a tolerance in the unit of the points."""
    settings = cv2.UsacParams()
    settings.sampler = cv2.SAMPLING_UNIFORM
    settings.score = cv2.SCORE_METHOD_MAGSAC
    settings.loMethod = cv2.LOCAL_OPTIM_SIGMA
    settings.threshold = tolerance
    settings.confidence = _CONFIDENCE
    settings.maxIterations = _TRIALS
    settings.randomGeneratorState = seed
    return settings
