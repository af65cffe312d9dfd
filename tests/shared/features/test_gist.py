import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.features.gist import DIMENSIONS, GRID, ORIENTATIONS, SCALES, gist


def published_image(size: int) -> NDArray[np.float32]:
    y, x = np.indices((size, size))
    return ((7 * x + 13 * y + x * y // 16) % 256).astype(np.float32)


def noise(height: int, width: int) -> NDArray[np.float32]:
    return np.random.default_rng(3).integers(0, 256, (height, width)).astype(np.float32)


@pytest.mark.parametrize(
    ("size", "first", "total", "norm"),
    [
        (64, [0.027698, 0.034157, 0.038667, 0.034970], 27.01041, 1.617329),
        (128, [0.031132, 0.041635, 0.030349, 0.021217], 32.38522, 2.136015),
        (256, [0.036330, 0.032079, 0.029737, 0.050577], 31.39062, 2.154849),
    ],
)
def test_values_are_those_of_the_authors_code(
    size: int, first: list[float], total: float, norm: float
) -> None:
    feature = gist(published_image(size), size)
    assert feature.shape == (DIMENSIONS,)
    assert feature.dtype == np.float32
    np.testing.assert_allclose(feature[:4], first, rtol=0, atol=1e-5)
    assert feature.sum(dtype=np.float64) == pytest.approx(total, abs=1e-5)
    assert np.linalg.norm(feature.astype(np.float64)) == pytest.approx(norm, abs=1e-5)


def test_a_mirrored_image_has_mirrored_orientations_and_columns() -> None:
    image = noise(64, 64)
    shape = (SCALES, ORIENTATIONS, GRID, GRID)  # the last two: column, row
    straight = gist(image, 64).reshape(shape)
    mirrored = gist(np.ascontiguousarray(image[:, ::-1]), 64).reshape(shape)
    turned_back = mirrored[:, -np.arange(ORIENTATIONS), ::-1]
    np.testing.assert_allclose(turned_back, straight, rtol=0.02)


def test_gain_and_offset_of_the_grey_levels_do_not_matter() -> None:
    image = noise(48, 80)
    np.testing.assert_allclose(gist(0.2 * image + 30, 64), gist(image, 64), atol=1e-5)


def test_an_even_image_has_no_shape() -> None:
    np.testing.assert_array_equal(gist(np.full((50, 70), 128, np.float32), 64), 0)
