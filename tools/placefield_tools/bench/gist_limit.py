"""The least work of GIST: the products of its matrices and the data they read, and nothing else.

Each filter is two matrix products of its box of frequencies, folded at the middle of box and image
(``placefield/features/gabor.py``). The products are real, in float32.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield_tools.bench.naive_gist import BORDER, CONTRAST_BORDER, gabor_filters

_LEAST_GAIN = 1e-5  # a box holds all frequencies with a larger gain
_SQUARE = 256  # side of the matrices of an ordinary product


@dataclass(frozen=True)
class Work:
    """Products, each with its addition, and bytes to read, of one frame."""

    products: int
    bytes_read: int


def gist_work(size: int) -> Work:
    """Count the work for an image (size, size)."""
    padded, half = size + 2 * BORDER, size // 2
    frequencies = padded // 2 + 1
    smoothed = size + 2 * CONTRAST_BORDER
    boxes = list(_boxes(padded))
    products = 4 * smoothed**3  # two low-pass filters, each of columns and of rows
    products += 4 * frequencies * half * (half + frequencies)  # the spectrum, in four parts
    products += sum(2 * half * columns * (rows + 2 * half) for rows, columns in boxes)
    numbers = smoothed**2 + 2 * frequencies * half + padded * half
    numbers += sum(rows * columns for rows, columns in boxes)  # the filters' gains
    return Work(products, 4 * numbers)


def bare(work: Work) -> Callable[[], object]:
    """Return what only multiplies and reads so much: one large product, one sum."""
    left = np.ones((round(work.products / _SQUARE**2), _SQUARE), np.float32)
    right, read = np.ones((_SQUARE, _SQUARE), np.float32), np.ones(work.bytes_read // 4, np.float32)
    return lambda: (left @ right, read @ read)


def _boxes(size: int) -> Iterator[tuple[int, int]]:
    """Yield rows and columns of each filter's box, both even."""
    for gains in gabor_filters(size):
        passed = np.fft.fftshift(gains) > _LEAST_GAIN
        yield _even_extent(np.any(passed, axis=1)), _even_extent(np.any(passed, axis=0))


def _even_extent(passed: NDArray[np.bool_]) -> int:
    first, *_, last = np.flatnonzero(passed).tolist()
    extent = last - first + 1
    return int(extent + extent % 2)
