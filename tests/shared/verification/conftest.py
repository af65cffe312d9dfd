"""Scenes of known geometry, and their images in two cameras."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.verification.two_views import Correspondences

FOCAL = 0.9

Array = NDArray[np.float64]


@pytest.fixture
def two_views() -> Callable[..., Correspondences]:
    """Make the correspondences of a random scene in two cameras."""

    def made(
        rotation: Array,
        position: Array,
        *,
        points: int = 150,
        wrong: float = 0.3,
        noise: float = 0.5,
        seed: int = 0,
    ) -> Correspondences:
        """``noise`` in pixels of 480, ``wrong`` is the share of points that lie anywhere."""
        rng = np.random.default_rng(seed)
        scene = rng.uniform((-5, -2, 4), (5, 2, 20), (points, 3))
        seen = [scene, (scene - position) @ rotation]
        one, other = (FOCAL * each[:, :2] / each[:, 2:] for each in seen)
        other[: int(wrong * points)] = rng.uniform(-0.5, 0.5, (int(wrong * points), 2))
        errors = rng.normal(0, noise / 480, (2, points, 2))
        return Correspondences(one + errors[0], other + errors[1], np.arange(points))

    return made


@pytest.fixture
def picture() -> Callable[[int], NDArray[np.uint8]]:
    """Make a picture of random patches, another one for each seed."""

    def made(seed: int) -> NDArray[np.uint8]:
        rng = np.random.default_rng(seed)
        pixels = np.full((240, 320), 128, np.uint8)
        for _ in range(300):
            middle = rng.integers(0, (320, 240)).tolist()
            axes = rng.integers(3, 20, 2).tolist()
            grey = int(rng.integers(256))
            cv2.ellipse(pixels, middle, axes, int(rng.integers(180)), 0, 360, grey, -1)
        return pixels

    return made
