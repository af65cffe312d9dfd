"""GIST: the shape of a scene in 512 numbers (Oliva and Torralba, 2001).

Parameters and steps are those of the authors' MATLAB code, so that the values compare with it:
intensity to 0..255, local contrast normalisation, 32 Gabor filters in the Fourier domain (4 scales
of 8 orientations), and the mean magnitude of each on a 4 x 4 grid.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from placefield.features.gabor import GRID, ORIENTATIONS, SCALES, gabor_magnitudes

DIMENSIONS = SCALES * ORIENTATIONS * GRID * GRID

_BORDER = 5  # symmetric padding for the contrast normalisation, pixels
_EVEN = 0.01  # grey levels: above rounding errors of a blank image, and below any real contrast
_CYCLES = 4.0  # cut-off of the contrast normalisation, cycles per image

Array = NDArray[np.float32]


def gist(images: Array) -> Array:
    """Describe square grey images by their GIST.

    Args:
        images: (..., size, size) float32 grey levels of any range; size is a multiple of 4.

    Returns:
        (..., 512) float32: filter by filter (scale major), each a 4 x 4 grid in column-major order.
        The values of an image do not depend on the other images.

    Raises:
        ValueError: size is no multiple of 4.
    """
    size = images.shape[-1]
    if size % GRID:
        raise ValueError(f"a side of {size} pixels does not divide into {GRID} equal cells")
    features = np.empty((*images.shape[:-2], DIMENSIONS), np.float32)
    # One by one: the data of one image stay in the processor's cache, those of several do not.
    for image, feature in zip(
        images.reshape(-1, size, size), features.reshape(-1, DIMENSIONS), strict=True
    ):
        feature[:] = gabor_magnitudes(_normalise_contrast(_stretch(image))).ravel()
    return features


def _stretch(image: Array) -> Array:
    """Map the grey levels to 0..255; a blank image becomes black."""
    low, high = float(image.min()), float(image.max())
    return (image - low) * np.float32(255 / (high - low) if high > low + _EVEN else 0)


def _normalise_contrast(image: Array) -> Array:
    """Take away the local mean of the log intensity and divide by its local deviation."""
    border = _padding(len(image))
    log = np.log(image + 1).take(border, axis=0).take(border, axis=1)
    detail = log - _smooth(log)
    deviation = np.sqrt(np.abs(_smooth(detail * detail)))
    inner = slice(_BORDER, -_BORDER)
    return np.asarray((detail / (0.2 + deviation))[inner, inner], np.float32)


def _smooth(image: Array) -> Array:
    low_pass = _low_pass(len(image))
    # In two halves: a larger product may run in threads, and their number would change the bits.
    halves = low_pass.reshape(2, -1, len(image))
    return np.asarray((halves @ image @ low_pass).reshape(image.shape), np.float32)


@lru_cache(maxsize=4)
def _padding(size: int) -> NDArray[np.intp]:
    return np.pad(np.arange(size), _BORDER, mode="symmetric")


@lru_cache(maxsize=4)
def _low_pass(size: int) -> Array:
    """Return the matrix (size, size) that applies a Gaussian low-pass filter to a line of pixels.

    The two-dimensional Gaussian is the product of two such filters, and the matrix is symmetric.
    """
    width = _CYCLES / np.sqrt(np.log(2))
    cycles = np.fft.fftfreq(size, 1 / size)
    response = np.fft.ifft(np.exp(-((cycles / width) ** 2))).real
    shifts = np.subtract.outer(np.arange(size), np.arange(size))
    return np.asarray(response[shifts % size], np.float32)
