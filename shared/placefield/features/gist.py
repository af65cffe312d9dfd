"""GIST: the shape of a scene in 512 numbers (Oliva and Torralba, 2001).

Parameters and steps are those of the authors' MATLAB code, so that the values compare with it:
intensity to 0..255, local contrast normalisation, 32 Gabor filters in the Fourier domain (4 scales
of 8 orientations), and the mean magnitude of each on a 4 x 4 grid.
"""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from placefield.features.grid import grid_means

SCALES = 4
ORIENTATIONS = 8
GRID = 4
DIMENSIONS = SCALES * ORIENTATIONS * GRID * GRID

_BORDER = 32  # symmetric padding against the wrap-around of the Fourier filters, pixels
_CONTRAST_BORDER = 5
_CONTRAST_CYCLES = 4.0  # cut-off of the contrast normalisation, cycles per image

Image = NDArray[np.float32]


def gist(image: Image, size: int) -> NDArray[np.float32]:
    """Describe a grey image by its GIST.

    Args:
        image: (H, W) grey levels of any range. The whole of it is resized to the square; the
            authors' code crops its centre, which on a route loses the sides of the street.
        size: side of the square that is described, pixels; even.

    Returns:
        (512,) float32: filter by filter (scale major), each a 4 x 4 grid in column-major order.
    """
    square = _stretch(_resize(image, size))
    padded = np.pad(_normalise_contrast(square), _BORDER, mode="symmetric")
    responses = fft.ifft2(fft.fft2(padded) * _gabor_filters(size + 2 * _BORDER))
    inner = slice(_BORDER, _BORDER + size)
    magnitudes = np.abs(responses[:, inner, inner])
    return grid_means(magnitudes, GRID, GRID).transpose(0, 2, 1).ravel()


def _resize(image: Image, size: int) -> Image:
    if image.shape == (size, size):
        return image
    return np.asarray(cv2.resize(image, (size, size), interpolation=cv2.INTER_AREA), np.float32)


def _stretch(image: Image) -> Image:
    """Map the grey levels to 0..255; an even image becomes black."""
    low, high = float(image.min()), float(image.max())
    return (image - low) * np.float32(255 / (high - low) if high > low else 0)


def _normalise_contrast(image: Image) -> Image:
    """Take away the local mean of the log intensity and divide by its local deviation."""
    log = np.pad(np.log1p(image), _CONTRAST_BORDER, mode="symmetric")
    low_pass = _low_pass(len(log))
    detail = log - _filter(log, low_pass)
    deviation = np.sqrt(np.abs(_filter(detail * detail, low_pass)))
    inner = slice(_CONTRAST_BORDER, -_CONTRAST_BORDER)
    return np.asarray((detail / (0.2 + deviation))[inner, inner], np.float32)


def _filter(image: Image, transfer: Image) -> Image:
    return np.asarray(fft.ifft2(fft.fft2(image) * transfer).real, np.float32)


@lru_cache(maxsize=8)
def _low_pass(size: int) -> Image:
    """Gaussian transfer function, (size, size), zero frequency first."""
    width = _CONTRAST_CYCLES / np.sqrt(np.log(2))
    x, y = _frequencies(size)
    return np.asarray(np.exp(-(x**2 + y**2) / width**2), np.float32)


@lru_cache(maxsize=8)
def _gabor_filters(size: int) -> NDArray[np.float32]:
    """Transfer functions of the 32 filters, (32, size, size), zero frequency first."""
    x, y = _frequencies(size)
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    filters = []
    for scale in range(SCALES):
        centre = 0.3 / 1.85**scale
        angular = 16 * ORIENTATIONS**2 / 32**2
        for orientation in range(ORIENTATIONS):
            turned = angle + np.pi / ORIENTATIONS * orientation
            turned -= 2 * np.pi * (turned > np.pi)
            radial_term = -10 * 0.35 * (radius / size / centre - 1) ** 2
            filters.append(np.exp(radial_term - 2 * angular * np.pi * turned**2))
    return np.asarray(filters, np.float32)


def _frequencies(size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    cycles = fft.fftfreq(size, 1 / size)
    x, y = np.meshgrid(cycles, cycles)
    return x, y
