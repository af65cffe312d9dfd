"""Mean magnitudes of Gabor responses, each filter within its band of frequencies.

A filter passes a box of frequencies, and almost nothing outside. With P = gain × spectrum in the
box, and j and l counted from its middle (±1/2, ±3/2, …), the response at a pixel y, x is

    r(y, x) = e^{iφ} Σ_j Σ_l P(j, l) e^{i(jy + lx)}.

The phase φ, the frequency of the middle, does not change the magnitude and is dropped. Folded at
the middle in both directions, the sum becomes one of real products over a quarter of the box,

    r = Σ_{j, l > 0} [(P_ee cos jy + i P_eo sin jy) cos lx + i (P_oe cos jy + i P_oo sin jy) sin lx]

where e and o stand for even and odd in l and in j. With pixels counted from the middle of the
image, mirrored pixels differ only in signs: matrix products give a quarter of the image, and sums
of them give the rest. For images of 64 pixels this is faster than Fourier transforms.
"""

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel

SCALES = 4
ORIENTATIONS = 8
GRID = 4

_BORDER = 32  # symmetric padding against the wrap-around of the Fourier filters, pixels
_LEAST_GAIN = 1e-5  # a box holds all frequencies with a larger gain; the largest gain is 1

Array = NDArray[np.float32]
Array64 = NDArray[np.float64]


class _Bands(NamedTuple):
    """The boxes of the filters, of 2J x 2L frequencies each, for images of 2h x 2h pixels.

    Attributes:
        boxes: (32, 5) intp: first row and column in the centred spectrum, J, L, and where the
            box's gains begin.
        gains: float32: (J, 4, L, 2) after (J, 4, L, 2), each from the middle of its box outwards,
            of re and im. On the left, that of im is negative, see ``_fold``.
        waves: (2, F, h) float32: cosines and sines of the frequencies 1/2, 3/2, … at the pixels
            1/2, 3/2, …
    """

    boxes: NDArray[np.intp]
    gains: Array
    waves: Array


def gabor_magnitudes(image: Array) -> Array:
    """Mean magnitudes of the 32 Gabor responses of an image over the cells of a 4 x 4 grid.

    Args:
        image: (size, size) float32; size is a multiple of 4. It is padded symmetrically.

    Returns:
        (32, 4, 4) float32: filters scale by scale; cells by column, then row.
    """
    means = np.empty((SCALES * ORIENTATIONS, GRID, GRID), np.float32)
    _describe_bands(_spectrum(image), *_bands(len(image)), means)
    return means


def _spectrum(image: Array) -> Array:
    """Fourier transform of the padded image: (n + 1, n + 1, 2) vertical, horizontal, re and im.

    Both frequencies run from -n/2 to n/2; pixels count from the middle of the image.
    """
    waves = _padded_waves(len(image))
    sums: Array = np.matmul(waves[:, None] @ _parts(image), waves.transpose(0, 2, 1))
    size = 2 * waves.shape[1] - 1
    spectrum = np.empty((size, size, 2), np.float32)
    _unfold(sums, spectrum)
    return spectrum


@kernel
def _unfold(sums: Array, spectrum: Array) -> None:
    """Put the spectrum together from the sums of its even and odd parts, (2, 2, n/2 + 1, n/2 + 1).

    The image is real: the upper half of the spectrum is the conjugate of the lower one, turned
    round.
    """
    (cc, cs), (sc, ss) = sums
    half = len(cc) - 1
    for row in range(half + 1):
        below, above = spectrum[half + row], spectrum[half - row]
        for column in range(half + 1):
            re, im = cc[row, column] - ss[row, column], cs[row, column] + sc[row, column]
            below[half + column, 0], below[half + column, 1] = re, -im
            above[half - column, 0], above[half - column, 1] = re, im
            re, im = cc[row, column] + ss[row, column], cs[row, column] - sc[row, column]
            below[half - column, 0], below[half - column, 1] = re, im
            above[half + column, 0], above[half + column, 1] = re, -im


def _parts(image: Array) -> Array:
    """Fold an image at its middle: (even or odd in y, likewise in x, size/2, size/2)."""
    half = len(image) // 2
    above, below = image[half - 1 :: -1], image[half:]
    rows = np.stack([below + above, below - above])
    left, right = rows[:, :, half - 1 :: -1], rows[:, :, half:]
    return np.stack([right + left, right - left], axis=1)


@lru_cache(maxsize=4)
def _padded_waves(size: int) -> Array:
    """Matrices that pad a line folded at its middle, and transform it: (2, n/2 + 1, size/2).

    That of even lines has cosines, that of odd ones sines, of the frequencies 0 to n/2.
    """
    n = size + 2 * _BORDER
    right = np.eye(size)[np.pad(np.arange(size), _BORDER, mode="symmetric")[n // 2 :]]
    same, mirrored = right[:, size // 2 :], right[:, size // 2 - 1 :: -1]
    angles = 2 * np.pi / n * np.outer(np.arange(n // 2 + 1), np.arange(n // 2) + 0.5)
    even, odd = np.cos(angles) @ (same + mirrored), np.sin(angles) @ (same - mirrored)
    return np.stack([even, odd]).astype(np.float32)


@kernel
def _describe_bands(
    spectrum: Array, boxes: NDArray[np.intp], gains: Array, waves: Array, means: Array
) -> None:
    """Put the mean magnitudes of each band's response into ``means`` (32, 4, 4)."""
    half = waves.shape[2]
    quarters = np.empty((2, 2, half, 2, half), np.float32)
    # One buffer for all boxes stays in the cache.
    buffer = np.empty(8 * (boxes[:, 2] * boxes[:, 3]).max(), np.float32)
    for band in range(len(boxes)):
        top, left, rows, columns, start = boxes[band]
        size = 8 * rows * columns
        box = gains[start : start + size].reshape(rows, 4, 2 * columns)
        folded = buffer[:size].reshape(2, 2, rows, 2 * columns)
        _fold(spectrum.reshape(len(spectrum), -1), top, 2 * left, box, folded)
        lines = np.empty((2 * columns, half), np.float32)
        for x in range(2):
            for y in range(2):
                np.dot(folded[x, y].T, waves[y, :rows], lines)
                pixels = quarters[x, y].reshape(half, 2 * half)
                np.dot(waves[x, :columns].T, lines.reshape(columns, 2 * half), pixels)
        _mean_magnitudes(quarters, means[band])


@kernel
def _fold(spectrum: Array, top: int, left: int, gains: Array, folded: Array) -> None:
    """Apply a box's gains and fold it into (even or odd in l, likewise in j, J, L re/im).

    The left half is read from its conjugate, so that all memory is read forwards. With re and im
    side by side there are half as many loops, each twice as long, which takes half the time.
    """
    rows, _, width = gains.shape
    middle, last = left + width, len(spectrum) - 1
    mirrored = spectrum.shape[1] - middle
    for row in range(rows):
        above, below = top + rows - 1 - row, top + rows + row
        above_left = spectrum[last - above, mirrored : mirrored + width]
        above_right = spectrum[above, middle : middle + width]
        below_left = spectrum[last - below, mirrored : mirrored + width]
        below_right = spectrum[below, middle : middle + width]
        for i in range(width):
            a = gains[row, 0, i] * above_left[i]
            b = gains[row, 1, i] * above_right[i]
            c = gains[row, 2, i] * below_left[i]
            d = gains[row, 3, i] * below_right[i]
            folded[0, 0, row, i] = (d + c) + (b + a)
            folded[0, 1, row, i] = (d + c) - (b + a)
            folded[1, 0, row, i] = (d - c) + (b - a)
            folded[1, 1, row, i] = (d - c) - (b - a)


@kernel
def _mean_magnitudes(quarters: Array, means: Array) -> None:
    """Combine the products (even or odd in x, likewise in y, h in x, re/im, h in y), and average.

    Each product gives four pixels, mirrored at the middle of the image. Their magnitudes are added
    to four cells of ``means`` (column, row).
    """
    half = quarters.shape[2]
    cell = half // 2
    for ring in range(2):
        sums = np.zeros((2, 2, half), np.float32)  # left or right, above or below, rows
        for x in range(ring * cell, (ring + 1) * cell):
            ee, eo, oe, oo = (
                quarters[0, 0, x],
                quarters[0, 1, x],
                quarters[1, 0, x],
                quarters[1, 1, x],
            )
            for y in range(half):
                re, im = ee[0, y] - oo[0, y], ee[1, y] - oo[1, y]
                odd_re, odd_im = -eo[1, y] - oe[1, y], eo[0, y] + oe[0, y]
                sums[1, 1, y] += _magnitude(re + odd_re, im + odd_im)
                sums[0, 0, y] += _magnitude(re - odd_re, im - odd_im)
                re, im = ee[0, y] + oo[0, y], ee[1, y] + oo[1, y]
                odd_re, odd_im = oe[1, y] - eo[1, y], eo[0, y] - oe[0, y]
                sums[0, 1, y] += _magnitude(re + odd_re, im + odd_im)
                sums[1, 0, y] += _magnitude(re - odd_re, im - odd_im)
        for outer in range(2):
            cells = sums[:, :, outer * cell : (outer + 1) * cell]
            for right in range(2):
                for below in range(2):
                    column = 2 + ring if right else 1 - ring
                    row = 2 + outer if below else 1 - outer
                    means[column, row] = cells[right, below].sum() / (cell * cell)


@kernel
def _magnitude(re: float, im: float) -> float:
    return math.sqrt(re * re + im * im)


@lru_cache(maxsize=4)
def _bands(size: int) -> _Bands:
    n = size + 2 * _BORDER
    boxes, gains, start = [], [], 0
    for passed in _filters(n):
        top, bottom = _even_range(passed.max(axis=1) > _LEAST_GAIN)
        left, right = _even_range(passed.max(axis=0) > _LEAST_GAIN)
        boxes.append((top, left, (bottom - top) // 2, (right - left) // 2, start))
        gains.append(_from_the_middle(passed[top:bottom, left:right] / n**2).ravel())
        start += gains[-1].size
    angles = 2 * np.pi / n * np.outer(np.arange(n // 2) + 0.5, np.arange(size // 2) + 0.5)
    waves = np.stack([np.cos(angles), np.sin(angles)])
    return _Bands(
        np.array(boxes, np.intp),
        np.concatenate(gains).astype(np.float32),
        waves.astype(np.float32),
    )


def _filters(n: int) -> Iterator[Array64]:
    """Gains of the filters, (n, n) each: vertical and horizontal frequency, both from -n/2."""
    cycles = np.arange(n) - n // 2
    radius, angle = np.hypot(cycles, cycles[:, None]), np.arctan2(cycles[:, None], cycles)
    for scale in range(SCALES):
        centre = 0.3 / 1.85**scale
        radial = 10 * 0.35 * (radius / n / centre - 1) ** 2
        for orientation in range(ORIENTATIONS):
            turned = angle + np.pi / ORIENTATIONS * orientation
            turned -= 2 * np.pi * (turned > np.pi)
            angular = 16 * ORIENTATIONS**2 / 32**2
            yield np.exp(-radial - 2 * angular * np.pi * turned**2)


def _from_the_middle(box: Array64) -> Array64:
    """Cut gains (2J, 2L) at their middle, for re and im: (J, 4, L, 2).

    The four parts are upper left, upper right, lower left and lower right.
    """
    rows, columns = len(box) // 2, box.shape[1] // 2
    halves = (box[rows - 1 :: -1], box[rows:])
    sides = [(half[:, columns - 1 :: -1], half[:, columns:]) for half in halves]
    gains = np.stack([*sides[0], *sides[1]], axis=1)[..., None] * np.ones(2)
    gains[:, ::2, :, 1] *= -1  # the left half is read from its conjugate
    return gains


def _even_range(wanted: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the shortest range of even length that holds all wanted elements."""
    first, *_, last = np.flatnonzero(wanted).tolist()
    if (last - first) % 2:
        return first, last + 1
    return (first - 1, last + 1) if first > 0 else (first, last + 2)
