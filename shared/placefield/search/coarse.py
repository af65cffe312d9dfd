"""The coarse search among many places: in few dimensions, at few bits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.search.inverted import InvertedLists
from placefield.search.quantized import Quantized
from placefield.search.spread import Spread, deviation_from, spread_of

AXES = 64
"""Dimensions of the coarse search: the row of a place is as long as a cache line."""

_SAMPLE = 20_000  # size of the sample of places that gives the axes
_BLOCK = 4096  # places whose float32 copy is held at once


@dataclass(frozen=True, eq=False)
class CoarseIndex:
    """The places of a metric, projected on the principal axes of a sample of them.

    Attributes:
        axes: (R, M) float32, orthonormal rows.
        codes: (K, R) int8, the projected and quantized places.
        spread: (M + 1, M + 1) float64, see ``spread_of``.
        unit: of ``codes``, in units of the places.
        lists: the codes of the places and of their looks in lists; None in an older map, and in a
            shard.
    """

    axes: NDArray[np.float32]
    codes: NDArray[np.int8]
    spread: Spread
    unit: float
    lists: InvertedLists | None = None

    def encode(self, vectors: Quantized) -> NDArray[np.int8]:
        """Project vectors (L, M) like the places, to codes (L, R)."""
        return _encode(vectors, self.axes, self.unit)

    def deviation(self, descriptor: Quantized) -> float:
        """Return the deviation of the exact squared distances of a vector (M,) to all places."""
        return deviation_from(descriptor, self.spread)


def coarse_index(places: Quantized) -> CoarseIndex:
    """Project places (K, M) on their ``AXES`` principal axes, or on all if they are fewer."""
    sample = places[:: -(-len(places) // _SAMPLE)].astype(np.float32)
    axes = np.linalg.svd(sample, full_matrices=False)[2][:AXES]
    unit = max(float(np.abs(sample @ axes.T).max()), 1.0) / np.iinfo(np.int8).max
    codes = _encode(places, axes, unit)
    return CoarseIndex(np.ascontiguousarray(axes), codes, spread_of(places), unit)


def _encode(places: Quantized, axes: NDArray[np.float32], unit: float) -> NDArray[np.int8]:
    codes = np.empty((len(places), len(axes)), np.int8)
    for block in blocks(len(places), _BLOCK):
        along = places[block].astype(np.float32) @ axes.T
        codes[block] = np.clip(np.rint(along / unit), -127, 127)
    return codes
