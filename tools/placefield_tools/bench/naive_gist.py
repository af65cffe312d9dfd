"""GIST straight from its definition: whole transforms in double precision, filter by filter."""

import numpy as np
from numpy.typing import NDArray

BORDER = 32  # pixels
CONTRAST_BORDER = 5
_CONTRAST_CYCLES = 4

Array = NDArray[np.float64]


class NaiveGist:
    """GIST of grey images of one size; the filters are made once, as the authors' code does."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._low_pass = _gaussian(size + 2 * CONTRAST_BORDER)
        self._filters = gabor_filters(size + 2 * BORDER)

    def __call__(self, image: NDArray[np.float32]) -> Array:
        """Describe an image (size, size): (512,) float64."""
        padded = np.pad(self._normalised(_stretched(image)), BORDER, mode="symmetric")
        spectrum = np.fft.fft2(padded)
        inner = slice(BORDER, BORDER + self._size)
        means = []
        for transfer in self._filters:
            magnitudes = np.abs(np.fft.ifft2(spectrum * transfer))[inner, inner]
            means += _cell_means(magnitudes)
        return np.array(means)

    def _normalised(self, image: Array) -> Array:
        log = np.pad(np.log(1 + image), CONTRAST_BORDER, mode="symmetric")
        detail = log - np.fft.ifft2(np.fft.fft2(log) * self._low_pass).real
        variance = np.fft.ifft2(np.fft.fft2(detail**2) * self._low_pass)
        inner = slice(CONTRAST_BORDER, CONTRAST_BORDER + self._size)
        return np.asarray((detail / (0.2 + np.sqrt(np.abs(variance))))[inner, inner], np.float64)


def _stretched(image: NDArray[np.float32]) -> Array:
    above = image.astype(np.float64) - image.min()
    return np.asarray(255 * above / max(above.max(), 1e-30), np.float64)


def _cell_means(magnitudes: Array) -> list[float]:
    side = len(magnitudes) // 4
    return [
        float(magnitudes[side * row : side * (row + 1), side * column : side * (column + 1)].mean())
        for column in range(4)
        for row in range(4)
    ]


def _gaussian(size: int) -> Array:
    x, y = _frequencies(size)
    width = _CONTRAST_CYCLES / np.sqrt(np.log(2))
    return np.asarray(np.exp(-(x**2 + y**2) / width**2), np.float64)


def gabor_filters(size: int) -> list[Array]:
    """Return the gains (size, size) of the 32 filters, frequencies as ``numpy.fft`` orders them."""
    x, y = _frequencies(size)
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    filters = []
    for scale in range(4):
        for orientation in range(8):
            turned = angle + np.pi * orientation / 8
            turned[turned > np.pi] -= 2 * np.pi
            radial = -10 * 0.35 * (radius / size / (0.3 / 1.85**scale) - 1) ** 2
            filters.append(np.exp(radial - 2 * (16 * 8**2 / 32**2) * np.pi * turned**2))
    return filters


def _frequencies(size: int) -> tuple[Array, Array]:
    cycles = np.fft.fftfreq(size, 1 / size)
    x, y = np.meshgrid(cycles, cycles)
    return x, y
