import numpy as np
import pytest

from placefield.features.gabor import GRID, ORIENTATIONS, SCALES, gabor_magnitudes


@pytest.mark.parametrize("scale", range(SCALES))
@pytest.mark.parametrize("orientation", range(ORIENTATIONS))
def test_a_wave_rouses_the_filter_of_its_frequency_and_direction(
    scale: int, orientation: int
) -> None:
    frequency = 2 * np.pi * 0.3 / 1.85**scale  # radians per pixel
    direction = -np.pi / ORIENTATIONS * orientation
    y, x = np.indices((128, 128))
    wave = np.cos(frequency * (np.cos(direction) * x + np.sin(direction) * y))
    means = gabor_magnitudes(wave.astype(np.float32))
    assert means.shape == (SCALES * ORIENTATIONS, GRID, GRID)
    inner = means[:, 1:3, 1:3].mean(axis=(1, 2))
    assert inner.argmax() == ORIENTATIONS * scale + orientation
    # The filter passes one of the wave's two frequencies, each of half its amplitude.
    assert inner.max() == pytest.approx(0.5, rel=0.05)


def test_a_dot_rouses_the_cell_that_it_lies_in() -> None:
    for column in range(GRID):
        for row in range(GRID):
            image = np.zeros((64, 64), np.float32)
            image[16 * row + 8, 16 * column + 8] = 1
            finest = gabor_magnitudes(image)[:ORIENTATIONS]
            np.testing.assert_array_equal(
                finest.reshape(ORIENTATIONS, -1).argmax(axis=1), GRID * column + row
            )
