"""Local features are RootSIFT, bounded in number, and independent of the size of the image."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.verification.extracting import extract

Picture = Callable[[int], NDArray[np.uint8]]


def test_an_image_has_at_most_so_many_local_features_and_they_are_its_strongest(
    picture: Picture,
) -> None:
    few, many = extract(picture(1), 50), extract(picture(1), 200)
    assert len(few.points) == 50
    assert len(many.points) == 200
    assert {*map(tuple, few.points.tolist())} <= {*map(tuple, many.points.tolist())}


def test_descriptors_are_the_roots_of_sifts_at_unit_sum(picture: Picture) -> None:
    found = extract(picture(2), 100).descriptors.astype(np.float64) / 512
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=0.02)


def test_points_do_not_depend_on_the_size_of_the_image(picture: Picture) -> None:
    pixels = picture(3)
    larger = cv2.resize(pixels, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    small, large = extract(pixels, 100).points, extract(np.asarray(larger, np.uint8), 100).points
    apart = np.linalg.norm(small[:, None] - large, axis=2).min(axis=1)
    assert np.median(apart) < 1 / 480
    assert np.abs(small).max() <= 0.5


def test_a_uniform_image_has_none_and_no_image_is_refused() -> None:
    assert extract(np.full((60, 80), 7, np.uint8), 10).points.shape == (0, 2)
    with pytest.raises(FrameError, match="float32"):
        extract(np.zeros((60, 80), np.float32), 10)  # type: ignore[arg-type]
