"""Grayscale: the image itself, made small."""

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 64, 48
DIMENSIONS = WIDTH * HEIGHT


def grayscale(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Resize a grey image (H, W) to 64 x 48 pixels and return them row by row, (3072,) float32."""
    small = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32).ravel()
