"""Quantized (fixed-point) descriptors, so that their products are exact.

The values of a vector become whole multiples of a unit. The unit is such that no vector is longer
than ``LONGEST`` units. By Cauchy and Schwarz no product of two of them, and no part of its sum,
then exceeds 2²⁴, the limit of whole numbers in float32. So a product in float32 or in int32, of one
vector or of many, in any order of summation and on any machine, is the same to the last bit. The
quantization error is a few ten-thousandths of a descriptor's length.
"""

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.kernels import kernel

LONGEST = 4000
"""Units in the length of the longest vector: 2¹², less a margin for rounding."""

DESCRIPTOR_UNIT = 1 / LONGEST
"""Unit of quantized descriptors, whose length is 1."""

_WORTH_BLAS = 24  # least vectors for which BLAS is faster
_BLOCK = 256  # rows whose float32 copy stays in the cache

Quantized = NDArray[np.int16]


def quantize(vectors: NDArray[np.floating], unit: float) -> Quantized:
    """Round vectors (..., N) to multiples of the unit; they are at most ``LONGEST`` units long."""
    return _rounded(np.multiply(vectors, np.float32(1 / unit)))


def _rounded(values: NDArray[np.floating]) -> Quantized:
    return np.asarray(np.rint(values, out=values), np.int16)


def products(rows: Quantized | NDArray[np.int8], vectors: Quantized) -> NDArray[np.int32]:
    """Multiply quantized vectors, (K, M) by (B, M) to (B, K), exactly, at memory speed.

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
def _multiply(
    rows: Quantized | NDArray[np.int8], vectors: Quantized, made: NDArray[np.int32]
) -> None:
    """Read every row once, for all vectors."""
    for k in range(len(rows)):
        for b in range(len(vectors)):
            made[b, k] = product_of(rows[k], vectors[b])


@kernel
def product_of(one: Quantized | NDArray[np.int8], other: Quantized) -> np.int32:
    """Multiply two vectors, (M,) each. Only int32 sums are vectorised at full width."""
    product = np.int32(0)
    for m in range(len(one)):
        product = np.int32(product + np.int32(np.int32(one[m]) * np.int32(other[m])))
    return product


class QuantizedProjection:
    """A projection v (M, N) of quantized descriptors, whose result is the same bits in any batch.

    Its entries are quantized too, and its result is rounded to multiples of ``unit``.
    """

    def __init__(self, projection: NDArray[np.float32], unit: float) -> None:
        """Prepare v, and the unit of its results (see ``projected_unit``)."""
        longest_row = float(np.linalg.norm(projection, axis=1).max())
        entry_unit = longest_row * DESCRIPTOR_UNIT
        self._entries = quantize(projection, entry_unit)
        self._rescale = entry_unit * DESCRIPTOR_UNIT / unit

    def __call__(self, descriptors: Quantized) -> Quantized:
        """Project quantized descriptors (B, N) to quantized vectors (B, M)."""
        return _rounded(products(self._entries, descriptors) * self._rescale)


def projected_unit(projection: NDArray[np.float32]) -> float:
    """Return the unit in which no projected descriptor is longer than ``LONGEST``."""
    return float(np.linalg.norm(projection, 2)) * DESCRIPTOR_UNIT
