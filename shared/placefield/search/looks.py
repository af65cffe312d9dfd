"""The looks of places: how further traverses observed them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.search.quantized import Quantized


@dataclass(frozen=True, eq=False)
class Looks:
    """Further descriptors of some places. A frame is compared with a place's nearest one.

    Attributes:
        places: (L,) int32, the place of each look, ascending; a place may have none or several.
        descriptors: (L, M) int16, projected and quantized like those of the places.
        squares: (L,) int32, their squared lengths.
        codes: (L, R) int8, for the coarse search, like those of the places; None without one.
    """

    places: NDArray[np.int32]
    descriptors: Quantized
    squares: NDArray[np.int32]
    codes: NDArray[np.int8] | None = None

    def __repr__(self) -> str:
        return f"Looks({len(self.places)} of {len(np.unique(self.places))} places)"

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays."""
        arrays = (self.places, self.descriptors, self.squares, self.codes)
        return sum(array.nbytes for array in arrays if array is not None)

    def between(self, start: int, stop: int) -> "Looks":
        """Return views of the looks of places from ``start`` up to ``stop``, numbered from 0."""
        rows = slice(*np.searchsorted(self.places, (start, stop)).tolist())
        codes = None if self.codes is None else self.codes[rows]
        places = self.places[rows] - np.int32(start)
        return Looks(places, self.descriptors[rows], self.squares[rows], codes)

    def of(self, chosen: NDArray[np.integer]) -> "Looks":
        """Return copies of the looks of the chosen places, (n,), without their codes.

        Their places are positions in ``chosen``.
        """
        at, rows = self.rows_of(chosen)
        return Looks(at, self.descriptors[rows], self.squares[rows])

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
