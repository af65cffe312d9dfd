"""An inverted file: codes in lists around centroids, so that a search reads the nearest lists only.

All sums are of whole numbers, so the lists, and what is found in them, are the same bits on every
machine.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.kernels import kernel
from placefield.search.quantized import Quantized, product_of, products

_ITERATIONS = 10  # of k-means
_SAMPLED = 32  # codes for each list that the centroids are computed from
_BLOCK = 1024  # codes that are assigned at once

Codes = NDArray[np.int8]
Numbers = NDArray[np.int32]


class InvertedLists(NamedTuple):
    """Codes of places and of their looks, a row each, in C lists.

    Attributes:
        centroids: (C, R) int8, of the lists.
        ends: (C,) int64, where each list ends; it begins where the one before it ends.
        places: (n,) int32, the place of each row.
        codes: (n, R) int8, of each row.
        squares: (n,) int32, squared length of each row's descriptor, plus the bias of its place.
    """

    centroids: Codes
    ends: NDArray[np.int64]
    places: Numbers
    codes: Codes
    squares: Numbers

    def nearest(self, along: Quantized, unit: float, lists: int, most: int) -> Numbers:
        """Return places near a vector, ascending.

        Args:
            along: (R,) int16, the vector along the axes of the codes.
            unit: of the codes, in units of the vector.
            lists: so many lists are read, those of the nearest centroids.
            most: so many rows are taken from them, the nearest ones.
        """
        (apart,) = products(self.centroids, along[None])
        probed = least_of(unit * _half_squares(self.centroids) - apart, lists)
        begins, ends = np.append(0, self.ends)[probed], self.ends[probed]
        rows = int((ends - begins).sum())
        distances, places = np.empty(rows, np.int32), np.empty(rows, np.int32)
        _read(self, begins, ends, along, unit, distances, places)
        return distinct(places[least_of(distances, most)])

    def beginning(self, count: int) -> "InvertedLists":
        """Return copies of the rows of the first so many places."""
        rows = np.flatnonzero(self.places < count)
        ends = np.searchsorted(rows, self.ends)
        copies = self.places[rows], self.codes[rows], self.squares[rows]
        for copy in (ends, *copies):  # the same compiled code is used
            copy.setflags(write=self.codes.flags.writeable)
        return InvertedLists(self.centroids, ends, *copies)


def inverted_lists(codes: Codes, places: Numbers, squares: Numbers) -> InvertedLists:
    """Divide the rows of an index, (n, R), into about sqrt(n) lists, see ``InvertedLists``."""
    count = max(math.isqrt(len(codes)), 1)
    centroids = _centroids(codes[:: -(-len(codes) // (_SAMPLED * count))], count)
    nearest = _assign(codes, centroids)
    order = np.argsort(nearest, kind="stable")
    ends = np.cumsum(np.bincount(nearest, minlength=count))
    return InvertedLists(centroids, ends, places[order], codes[order], squares[order])


def _centroids(sample: Codes, count: int) -> Codes:
    """Return the centroids of a sample by k-means, (count, R), rounded in each iteration."""
    centroids = sample[:: max(len(sample) // count, 1)][:count].copy()
    for _ in range(_ITERATIONS):
        nearest = _assign(sample, centroids)
        order = np.argsort(nearest, kind="stable")
        sizes = np.bincount(nearest, minlength=count)
        some = np.flatnonzero(sizes)
        begins = (np.cumsum(sizes) - sizes)[some]
        sums = np.add.reduceat(sample[order], begins, axis=0, dtype=np.int64)
        centroids[some] = np.rint(sums / sizes[some, None])
    return centroids


def _assign(codes: Codes, centroids: Codes) -> NDArray[np.int32]:
    """Return the nearest centroid of each code, (n,); the first one of several."""
    nearest = np.empty(len(codes), np.int32)
    turned, half = centroids.T.astype(np.float32), _half_squares(centroids).astype(np.float32)
    for block in blocks(len(codes), _BLOCK):  # all sums are exact in float32
        nearest[block] = np.argmax(codes[block].astype(np.float32) @ turned - half, axis=1)
    return nearest


def _half_squares(centroids: Codes) -> NDArray[np.float64]:
    wide = centroids.astype(np.int32)
    return np.asarray((wide * wide).sum(axis=1) / 2)


def least_of(values: NDArray[np.int32] | NDArray[np.float64], most: int) -> NDArray[np.intp]:
    """Return where the least values are, ascending; of equal ones the first."""
    if len(values) <= most:
        return np.arange(len(values))
    limit = np.partition(values, most - 1)[most - 1]
    within = np.flatnonzero(values <= limit)
    if len(within) > most:
        below = np.flatnonzero(values < limit)
        equal = np.flatnonzero(values == limit)
        within = np.sort(np.concatenate([below, equal[: most - len(below)]]))
    return within


def distinct(numbers: Numbers) -> Numbers:
    """Return the distinct numbers of (n,), ascending; ``np.unique`` takes ten times as long."""
    ascending = np.sort(numbers)
    is_first = np.append(True, ascending[1:] != ascending[:-1])[: len(ascending)]
    return np.asarray(ascending[is_first])


@kernel
def _read(
    lists: InvertedLists,
    begins: NDArray[np.int64],
    ends: NDArray[np.int64],
    along: Quantized,
    unit: float,
    distances: Numbers,
    places: Numbers,
) -> None:
    """Write the squared distance and the place of each row of some lists, up to a constant."""
    at = 0
    for number in range(len(begins)):
        for row in range(begins[number], ends[number]):
            product = np.int32(unit * product_of(lists.codes[row], along))
            distances[at] = np.int32(lists.squares[row] - 2 * product)
            places[at] = lists.places[row]
            at += 1
