import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.features.shrink import small_grey


def noise(*shape: int) -> NDArray[np.uint8]:
    return np.random.default_rng(9).integers(0, 256, shape, np.uint8)


def area_means(grey: NDArray[np.float64], height: int, width: int) -> NDArray[np.float64]:
    """Divide each pixel into as many as the result has: each cell then holds whole ones."""
    rows, columns = grey.shape
    fine = grey.repeat(height, axis=0).repeat(width, axis=1)
    return fine.reshape(height, rows, width, columns).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("rows", "columns", "height", "width"),
    [(48, 64, 12, 16), (37, 50, 12, 16), (23, 31, 12, 16), (12, 16, 12, 16), (13, 99, 12, 1)],
)
def test_a_value_is_the_mean_over_the_area_that_it_covers(
    rows: int, columns: int, height: int, width: int
) -> None:
    pixels = noise(rows, columns, 3)
    expected = area_means(pixels.mean(axis=2), height, width)
    small = small_grey(pixels, height, width)
    assert small.dtype == np.float32
    np.testing.assert_allclose(small, expected, rtol=1e-6)
    alone = area_means(pixels[..., 0].astype(np.float64), height, width)
    np.testing.assert_allclose(small_grey(pixels[..., 0], height, width), alone, rtol=1e-6)


@pytest.mark.parametrize(("rows", "columns"), [(8, 8), (8, 90), (90, 8)])
def test_a_smaller_image_is_enlarged_as_opencv_does(rows: int, columns: int) -> None:
    pixels = noise(rows, columns, 3)
    grey = pixels.mean(axis=2, dtype=np.float32)
    expected = cv2.resize(grey, (64, 48), interpolation=cv2.INTER_AREA)
    np.testing.assert_allclose(small_grey(pixels, 48, 64), expected, rtol=1e-5)


@pytest.mark.parametrize("level", [0, 1, 255])
def test_an_even_image_stays_even(level: int) -> None:
    small = small_grey(np.full((480, 639, 3), level, np.uint8), 64, 64)
    np.testing.assert_allclose(small, level, rtol=1e-6)


@pytest.mark.parametrize("shape", [(99,), (99, 99, 1), (99, 99, 4)])
def test_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(FrameError, match="shape"):
        small_grey(noise(*shape), 8, 8)


@pytest.mark.parametrize("shape", [(0, 0), (0, 9), (9, 0), (0, 9, 3), (9, 0, 3)])
def test_an_image_without_a_pixel_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(FrameError, match="no pixels"):
        small_grey(np.empty(shape, np.uint8), 8, 8)
