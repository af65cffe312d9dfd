"""Small images of query frames."""

import numpy as np
from numpy.typing import NDArray

from placefield.bus.messages import FrameMessage
from placefield.features import images

_LONGEST = 640  # pixels of a side


def picture_of(frame: FrameMessage) -> bytes | None:
    """Return the image of a frame as a small JPEG, see ``small_jpeg``; None for a descriptor.

    Raises:
        FrameError: the image cannot be read.
    """
    return None if frame.image is None else small_jpeg(frame.image)


def small_jpeg(image: bytes | NDArray[np.uint8]) -> bytes:
    """Return a frame's image as JPEG, at most 640 pixels wide and high.

    Raises:
        FrameError: the image cannot be read.
    """
    pixels = images.pixels_of(image)
    images.check_pixels(pixels)
    return images.small_jpeg(pixels, _LONGEST)
