"""Small pictures of query frames."""

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.features.images import check_pixels, decode

_WIDTH = 640  # pixels
_QUALITY = 80


def small_jpeg(image: bytes | NDArray[np.uint8]) -> bytes:
    """Return a frame's image as JPEG, at most 640 pixels wide.

    Raises:
        FrameError: it cannot be read.
    """
    pixels = decode(image) if isinstance(image, bytes) else image
    check_pixels(pixels)
    height, width = pixels.shape[:2]
    if width > _WIDTH:
        size = (_WIDTH, max(1, round(height * _WIDTH / width)))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
