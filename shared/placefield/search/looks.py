"""The looks of places: further descriptors of them, as other traverses observed them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.search.quantized import Quantized, products

MOST_BIAS = 2**26
"""More than any squared distance of quantized descriptors."""

_SAMPLED = 128  # places, and looks, that represent the frames for the biases
_AT_ONCE = 16  # of these are compared at once


@dataclass(frozen=True, eq=False)
class Looks:
    """Further descriptors of some of the K places of a map.

    The distance of a place is that of the nearest of its descriptors, plus the place's bias.
    Without the bias, a place with looks would be nearer than others to any frame.

    Attributes:
        places: (L,) int32, the place of each look, ascending; a place may have none or several.
        descriptors: (L, M) int16, projected and quantized like those of the places.
        squares: (L,) int32, their squared lengths.
        biases: (K,) int32, by how much as many looks as a place has lower its squared distance to
            a frame on average; 0 for a place without looks.
        codes: (L, R) int8, for the coarse search, like those of the places; None without one.
        traverses: (L,) int32, the number of the traverse that each look is of; None if the map does
            not say.
    """

    places: NDArray[np.int32]
    descriptors: Quantized
    squares: NDArray[np.int32]
    biases: NDArray[np.int32]
    codes: NDArray[np.int8] | None = None
    traverses: NDArray[np.int32] | None = None

    def __repr__(self) -> str:
        return f"Looks({len(self.places)} of {np.count_nonzero(self.biases)} places)"

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        arrays = (
            self.places,
            self.descriptors,
            self.squares,
            self.biases,
            self.codes,
            self.traverses,
        )
        return sum(array.nbytes for array in arrays if array is not None)

    def between(self, start: int, stop: int) -> "Looks":
        """Return the looks of places from ``start`` up to ``stop``, numbered from 0, as views.

        They do not say of which traverse they are.
        """
        rows = slice(*np.searchsorted(self.places, (start, stop)).tolist())
        places = self.places[rows] - np.int32(start)
        places.setflags(write=self.places.flags.writeable)  # the same compiled code is used
        return Looks(
            places,
            self.descriptors[rows],
            self.squares[rows],
            self.biases[start:stop],
            None if self.codes is None else self.codes[rows],
        )

    def of(self, chosen: NDArray[np.integer]) -> "Looks":
        """Return copies of the looks of the chosen places, (n,), without their codes.

        They do not say of which traverse they are. Their places are positions in ``chosen``.
        """
        at, rows = self.rows_of(chosen)
        return Looks(at, self.descriptors[rows], self.squares[rows], self.biases[chosen])

    def rows_of(self, chosen: NDArray[np.integer]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the looks of the chosen places, (n,).

        Returns:
            For each look of a chosen place, the position of the place in ``chosen``, ascending, and
            the number of the look.
        """
        first = np.searchsorted(self.places, chosen, "left")
        counts = np.searchsorted(self.places, chosen, "right") - first
        at = np.repeat(np.arange(len(chosen), dtype=np.int32), counts)
        before = np.cumsum(counts) - counts
        return at, np.asarray((first - before)[at] + np.arange(len(at)), np.int32)


def looks_at(
    places: Quantized,
    squares: NDArray[np.int32],
    shown: NDArray[np.int32],
    descriptors: Quantized,
    codes: NDArray[np.int8] | None,
    traverses: NDArray[np.int32] | None = None,
) -> Looks:
    """Return looks with their biases.

    An evenly spaced sample of the descriptors of the places, and one of the looks, are the frames
    for the biases.

    Args:
        places: (K, M), the quantized descriptors of the places.
        squares: (K,), their squared lengths.
        shown: (L,), the place of each look, ascending.
        descriptors: (L, M), of the looks.
        codes: (L, R), for the coarse search; None without one.
        traverses: (L,), the traverse of each; None if it is not known.
    """
    look_squares = squared_lengths(descriptors)
    sample = np.concatenate([each[:: -(-len(each) // _SAMPLED)] for each in (places, descriptors)])
    lowered = np.zeros(len(places), np.int64)
    for block in blocks(len(sample), _AT_ONCE):
        own = squares - 2 * products(places, sample[block])
        looked = look_squares - 2 * products(descriptors, sample[block])
        for distances, of_looks in zip(own, looked, strict=True):
            nearest = distances.copy()
            np.minimum.at(nearest, shown, of_looks)
            lowered += distances - nearest
    # Of all places with as many looks: of a single place the estimate is too uncertain.
    counts = np.bincount(shown, minlength=len(places))
    alike = np.bincount(counts)
    means = np.bincount(counts, lowered) / np.maximum(alike, 1) / len(sample)
    biases = np.rint(means[counts]).astype(np.int32)
    return Looks(shown, descriptors, look_squares, biases, codes, traverses)


def squared_lengths(vectors: Quantized) -> NDArray[np.int32]:
    """Return the squared lengths, (K,), of quantized vectors (K, M)."""
    return np.asarray(np.einsum("km,km->k", vectors, vectors, dtype=np.int32))
