"""Fixed-point vectors, so that their products are exact.

A vector's values become whole numbers, its codes, of a unit such that no vector is longer than
``LONGEST`` codes. By Cauchy and Schwarz no product of two of them, and no part of its sum, then
exceeds 2²⁴, up to which float32 counts in ones. So a product in float32, in int32, of one vector or
of many, in whatever order it is summed and on whatever machine, has the same value to the last bit.
The codes' rounding is a few ten-thousandths of a descriptor's length.
"""

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.kernels import kernel

LONGEST = 4000
"""Codes in the length of the longest vector: 2¹² less what rounding and slack may add to it."""

DESCRIPTOR_UNIT = 1 / LONGEST
"""Of descriptors, whose length is 1."""

_WORTH_BLAS = 24  # vectors
_BLOCK = 256  # rows whose float32 copy stays in the cache

Codes = NDArray[np.int16]


def codes_of(vectors: NDArray[np.floating], unit: float) -> Codes:
    """Round vectors (..., N) to multiples of the unit; their lengths are ``LONGEST`` at most."""
    return _rounded(np.multiply(vectors, np.float32(1 / unit)))


def _rounded(values: NDArray[np.floating]) -> Codes:
    return np.asarray(np.rint(values, out=values), np.int16)


def products(rows: Codes | NDArray[np.int8], vectors: Codes) -> NDArray[np.int32]:
    """Multiply codes, (K, M) by (B, M) to (B, K): exactly, and as fast as the machine reads.

    The rows may be mapped from a file; no copy of all of them is made.
    """
    made = np.empty((len(vectors), len(rows)), np.int32)
    if len(vectors) < _WORTH_BLAS:
        _multiply(rows, vectors, made)
    else:
        floats = vectors.astype(np.float32)
        for block in blocks(len(rows), _BLOCK):
            made[:, block] = floats @ rows[block].astype(np.float32).T
    return made


@kernel
def _multiply(rows: Codes | NDArray[np.int8], vectors: Codes, made: NDArray[np.int32]) -> None:
    """Read every row once, for all vectors."""
    for k in range(len(rows)):
        for b in range(len(vectors)):
            made[b, k] = product_of(rows[k], vectors[b])


@kernel
def product_of(codes: Codes | NDArray[np.int8], other: Codes) -> np.int32:
    """Multiply two vectors of codes, (M,) each. Only int32 sums are vectorised at full width."""
    product = np.int32(0)
    for m in range(len(codes)):
        product = np.int32(product + np.int32(np.int32(codes[m]) * np.int32(other[m])))
    return product


class CodedProjection:
    """A projection v (M, N) of descriptors that takes codes to codes, to the same bits in batches.

    Its own entries are codes too, and its result is rounded to codes of ``unit``.
    """

    def __init__(self, projection: NDArray[np.float32], unit: float) -> None:
        """Take v, and the unit of what it gives (see ``projected_unit``)."""
        longest_row = float(np.linalg.norm(projection, axis=1).max())
        entry_unit = longest_row * DESCRIPTOR_UNIT
        self._entries = codes_of(projection, entry_unit)
        self._rescale = entry_unit * DESCRIPTOR_UNIT / unit

    def __call__(self, descriptors: Codes) -> Codes:
        """Project the codes of descriptors (B, N) to codes (B, M)."""
        return _rounded(products(self._entries, descriptors) * self._rescale)


def projected_unit(projection: NDArray[np.float32]) -> float:
    """Return the unit in which no descriptor under the projection is longer than ``LONGEST``."""
    return float(np.linalg.norm(projection, 2)) * DESCRIPTOR_UNIT
