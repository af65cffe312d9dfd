"""OpenCV's video capture, which both videos and cameras are read with."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from cv2.utils import logging
from numpy.typing import NDArray

# FFmpeg warns whenever a stream ends; our own errors report failures. OpenCV reads this once.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Suppress OpenCV's warnings on stderr, where our own error says the same in one line."""
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


def grab_every(
    capture: cv2.VideoCapture, numbers: Iterator[int], start: int, stride: int
) -> Iterator[int]:
    """Grab all frames to the end, and yield the number of each ``stride``-th from ``start`` on.

    The caller converts a yielded frame with ``retrieve``; the other frames are never converted.
    """
    for number in numbers:
        if not capture.grab():
            return
        if number >= start and (number - start) % stride == 0:
            yield number


def retrieve(capture: cv2.VideoCapture) -> NDArray[np.uint8] | None:
    """Return the grabbed frame, (H, W, 3) BGR, or None where it does not decode."""
    decoded, pixels = capture.retrieve()
    return np.asarray(pixels, np.uint8) if decoded else None
