"""Downscaling of colour pixels to a small grey image, in one pass."""

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.features.images import check_pixels, grey
from placefield.kernels import kernel

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]


def small_grey(pixels: Pixels, height: int, width: int) -> Array:
    """Average the colour channels and resize to (height, width), float32 in 0 … 255.

    Each value is the mean over the area that its pixel covers in the image. If the image is smaller
    than the result in one direction, OpenCV interpolates.

    Args:
        pixels: (H, W) or (H, W, 3) uint8.
        height: of the result, pixels.
        width: of the result, pixels.

    Raises:
        FrameError: the pixels have another shape or dtype, or there are none.
    """
    check_pixels(pixels)
    rows, columns = pixels.shape[:2]
    if rows < height or columns < width:
        enlarged = cv2.resize(grey(pixels), (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(enlarged, np.float32)
    lines = np.ascontiguousarray(pixels).reshape(rows, -1)
    shorter = np.zeros((height, lines.shape[1]), np.float32)
    _average_rows(lines, *_areas(rows, height, 1), shorter)
    small = np.empty((height, width), np.float32)
    _average_columns(shorter, *_areas(columns, width, lines.shape[1] // columns), small)
    return small


@kernel
def _average_rows(lines: Pixels, firsts: NDArray[np.intp], shares: Array, means: Array) -> None:
    """Add up the rows (H, C) that each row of ``means`` (h, C) covers, weighted by ``shares``."""
    for row in range(len(firsts)):
        for tap in range(shares.shape[1]):
            share, line = shares[row, tap], lines[firsts[row] + tap]
            for column in range(len(line)):
                means[row, column] += share * np.float32(line[column])


@kernel
def _average_columns(lines: Array, firsts: NDArray[np.intp], shares: Array, means: Array) -> None:
    """Add up the values of a line (h, C) that each of ``means`` (h, w) covers, by ``shares``."""
    for row in range(means.shape[0]):
        line = lines[row]
        for column in range(means.shape[1]):
            covered = line[firsts[column] :]
            mean = np.float32(0)
            for tap in range(shares.shape[1]):
                mean += shares[column, tap] * covered[tap]
            means[row, column] = mean


@lru_cache(maxsize=16)
def _areas(length: int, parts: int, channels: int) -> tuple[NDArray[np.intp], Array]:
    """Divide a line of ``length`` pixels, of interleaved channels, into equal parts.

    Returns:
        The first value of each part, (parts,), and the weights of the values from there on in the
        part's mean, (parts, T) float32; T is the most values that a part covers.
    """
    taps = min(length, -(-length // parts) + 1)
    starts = np.arange(parts) * length / parts
    firsts = np.minimum(starts.astype(np.intp), length - taps)
    pixels, starts = firsts[:, None] + np.arange(taps), starts[:, None]
    covered = np.minimum(pixels + 1, starts + length / parts) - np.maximum(pixels, starts)
    shares = np.maximum(covered, 0) * parts / length / channels
    return firsts * channels, np.repeat(shares, channels, axis=1).astype(np.float32)
