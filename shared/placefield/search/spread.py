"""The spread of places in descriptor space, which gives that of their distances to a frame."""

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.search.quantized import Quantized

_BLOCK = 4096  # places whose float64 copy is held at once

Spread = NDArray[np.float64]


def spread_of(places: Quantized) -> Spread:
    """Return the covariance of quantized places (K, M) and of their squared lengths.

    It is (M + 1, M + 1) float64; the lengths are its last row and column. The places may be mapped
    from a file; no copy of all of them is made.
    """
    # Differences from the first place, so that equal places have no spread by rounding.
    origin = _with_squares(places[:1])
    total = np.zeros(places.shape[1] + 1)
    products = np.zeros((len(total), len(total)))
    for block in blocks(len(places), _BLOCK):
        some = _with_squares(places[block]) - origin
        total += some.sum(axis=0)
        products += some.T @ some
    mean = total / len(places)
    return np.asarray(products / len(places) - np.outer(mean, mean))


def _with_squares(places: Quantized) -> NDArray[np.float64]:
    some = places.astype(np.float64)
    return np.column_stack([some, np.einsum("km,km->k", some, some)])


def deviation_from(descriptor: Quantized, spread: Spread) -> float:
    """Return the standard deviation of the squared distances of a vector (M,) to all places.

    These are |x|² + |r_j|² - 2 x r_j, so their variance is a quadratic form of x.
    """
    form = np.append(-2.0 * descriptor, 1.0)
    return float(np.sqrt(max(form @ spread @ form, 0.0)))
