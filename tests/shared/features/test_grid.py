import numpy as np
import pytest

from placefield.features.grid import grid_means


@pytest.mark.parametrize(("height", "width"), [(14, 14), (15, 20), (4, 3), (7, 5)])
def test_a_cell_is_the_mean_of_its_pixels_and_each_pixel_is_of_one_cell(
    height: int, width: int
) -> None:
    maps = np.random.default_rng(0).normal(size=(5, height, width)).astype(np.float32)
    means = grid_means(maps, 4, 3)
    assert means.shape == (5, 4, 3)
    assert means.dtype == np.float32
    for row in range(4):
        for column in range(3):
            tops = slice(row * height // 4, (row + 1) * height // 4)
            lefts = slice(column * width // 3, (column + 1) * width // 3)
            cell = maps[:, tops, lefts].mean(axis=(1, 2))
            np.testing.assert_allclose(means[:, row, column], cell, atol=1e-6)
