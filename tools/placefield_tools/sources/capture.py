"""What reading a video and reading a camera have in common: OpenCV's capture."""

import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from cv2.utils import logging
from numpy.typing import NDArray


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Keep OpenCV's warnings off stderr while an error of ours says the same in one line."""
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


def frame_rate(capture: cv2.VideoCapture, stride: int) -> float | None:
    """Return the rate in 1/s of every ``stride``-th frame, None where the driver knows none."""
    rate = capture.get(cv2.CAP_PROP_FPS)
    return rate / stride if rate > 0 and math.isfinite(rate) else None


def grab_every(capture: cv2.VideoCapture, start: int, stride: int) -> Iterator[int]:
    """Grab all frames until none comes; yield the index of each ``stride``-th from ``start``.

    What is yielded is still to be taken with ``retrieve``; the others are never converted.
    """
    for index in itertools.count():
        if not capture.grab():
            return
        if index >= start and (index - start) % stride == 0:
            yield index


def retrieve(capture: cv2.VideoCapture) -> NDArray[np.uint8] | None:
    """Return the grabbed frame, (H, W, 3) BGR, or None where it does not decode."""
    decoded, pixels = capture.retrieve()
    return np.asarray(pixels, np.uint8) if decoded else None
