"""The grayscale feature: the downscaled image itself."""

import numpy as np
from numpy.typing import NDArray

from placefield.features.shrink import small_grey

WIDTH, HEIGHT = 64, 48
DIMENSIONS = WIDTH * HEIGHT


def grayscale(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Downscale (H, W) or (H, W, 3) uint8 to 64 x 48 grey pixels, row by row: (3072,) float32.

    Raises:
        FrameError: the pixels have another shape or dtype.
    """
    return small_grey(pixels, HEIGHT, WIDTH).ravel()
