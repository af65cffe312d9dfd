import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.features.gist import DIMENSIONS, GRID, ORIENTATIONS, SCALES, gist
from placefield_tools.bench.naive_gist import NaiveGist


def published_image(size: int) -> NDArray[np.float32]:
    y, x = np.indices((size, size))
    return ((7 * x + 13 * y + x * y // 16) % 256).astype(np.float32)


def noise(*shape: int, seed: int = 3) -> NDArray[np.float32]:
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.float32)


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
    feature = gist(published_image(size))
    assert feature.shape == (DIMENSIONS,)
    assert feature.dtype == np.float32
    np.testing.assert_allclose(feature[:4], first, rtol=0, atol=1e-5)
    assert feature.sum(dtype=np.float64) == pytest.approx(total, abs=1e-5)
    assert np.linalg.norm(feature.astype(np.float64)) == pytest.approx(norm, abs=1e-5)


@pytest.mark.parametrize("size", [36, 64, 100])
def test_values_are_those_of_the_plain_definition(size: int) -> None:
    y, x = np.indices((size, size))
    images = [
        noise(size, size),
        np.cumsum(noise(size, size) - 127.5, axis=0),  # as smooth as a street
        100 + 50 * np.sin(0.3 * x + 2.9 * y),  # in the band of few filters
        np.where((x > 20) & (y > 30), 255, 0),
    ]
    plain = NaiveGist(size)
    for image in images:
        grey = image.astype(np.float32)
        expected = plain(grey)
        np.testing.assert_allclose(gist(grey), expected, rtol=0, atol=1e-5 * expected.max())


def test_an_image_has_the_same_values_to_the_bit_alone_and_in_any_stack() -> None:
    images = noise(17, 64, 64)
    alone = np.stack([gist(image) for image in images])
    for count in (1, 2, 8, 17):
        np.testing.assert_array_equal(gist(images[:count]), alone[:count])
        np.testing.assert_array_equal(gist(images[::-1][:count]), alone[::-1][:count])
    np.testing.assert_array_equal(gist(images[:6].reshape(2, 3, 64, 64))[1, 2], alone[5])


def test_a_mirrored_image_has_mirrored_orientations_and_columns() -> None:
    image = noise(64, 64)
    shape = (SCALES, ORIENTATIONS, GRID, GRID)  # the last two: column, row
    straight = gist(image).reshape(shape)
    mirrored = gist(image[:, ::-1]).reshape(shape)
    turned_back = mirrored[:, -np.arange(ORIENTATIONS), ::-1]
    np.testing.assert_allclose(turned_back, straight, rtol=0.02)


def test_gain_and_offset_of_the_grey_levels_do_not_matter() -> None:
    image = noise(64, 64)
    np.testing.assert_allclose(gist(0.2 * image + 30), gist(image), atol=1e-5)


def test_an_even_image_has_no_shape() -> None:
    np.testing.assert_array_equal(gist(np.full((64, 64), 128, np.float32)), 0)


def test_a_side_that_does_not_divide_into_the_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="66"):
        gist(noise(66, 66))
