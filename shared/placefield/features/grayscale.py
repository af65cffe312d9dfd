"""Grayscale: the image itself, made small."""

import numpy as np
from numpy.typing import NDArray

from placefield.features.shrink import small_grey

WIDTH, HEIGHT = 64, 48
DIMENSIONS = WIDTH * HEIGHT


def grayscale(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Make (H, W) or (H, W, 3) uint8 grey and 64 x 48 pixels, row by row: (3072,) float32.

    Raises:
        FrameError: the pixels are of another shape or dtype.
    """
    return small_grey(pixels, HEIGHT, WIDTH).ravel()
