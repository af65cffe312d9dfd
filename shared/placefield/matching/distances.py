"""Distances of a query frame to every place, under a channel's metric (Eqs. 5 to 7)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

GRID = 2.0**-20
"""Distances are multiples of this, so that float64 sums of up to millions of them are exact: in
whatever order they are added, and wherever a window begins, not one bit of the sum changes."""


class PlaceDistances:
    """Squared distances ||v x - v r_j||^2 of a descriptor x to the places r_j of a map."""

    def __init__(self, projection: Array, projected_places: Array) -> None:
        """Take the projection v, (M, N) float32, and the places under it, v r_j, (K, M) float32."""
        self._projection = projection
        self.places = projected_places
        self._squares = np.einsum("km,km->k", projected_places, projected_places)

    @property
    def count(self) -> int:
        """How many places there are."""
        return len(self.places)

    def project(self, descriptor: Array) -> Array:
        """Return a descriptor (N,) under the metric, v x, (M,)."""
        return self._projection @ descriptor

    def to(self, projected: Array) -> Array:
        """Return the distance of a projected descriptor (M,) to each place, (K,), on the grid."""
        squares = self._squares + projected @ projected - 2 * (self.places @ projected)
        return on_grid(np.maximum(squares, 0))


def on_grid(distances: Array) -> Array:
    """Round distances to multiples of ``GRID``."""
    return np.asarray(np.rint(distances * np.float32(1 / GRID)) * np.float32(GRID), np.float32)
