"""What reading a video and reading a camera have in common: OpenCV's capture."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from cv2.utils import logging
from numpy.typing import NDArray

# FFmpeg, which OpenCV asks for this once, warns whenever a stream ends; what fails, we say.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Keep OpenCV's warnings off stderr while an error of ours says the same in one line."""
    level = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


def grab_every(
    capture: cv2.VideoCapture, numbers: Iterator[int], start: int, stride: int
) -> Iterator[int]:
    """Grab all frames until none comes; yield the number of each ``stride``-th from ``start``.

    What is yielded is still to be taken with ``retrieve``; the others are never converted.
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
