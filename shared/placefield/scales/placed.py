"""Descriptors with their positions in the route, so that clusters become consecutive."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_RELATED = (
    20  # frames; at weight 1, frames so far apart differ as much by position as by descriptor
)
_COLUMNS = 32  # dimensions whose float64 copy is held at once


@dataclass(frozen=True)
class Placed:
    """Vectors at positions in the route; the position is one more dimension of each.

    Attributes:
        vectors: (n, N) float32.
        positions: (n,) float32 or float64, in the unit of the vectors; all 0 if they do not count.
            Those of frames ascend.
    """

    vectors: NDArray[np.float32]
    positions: NDArray[np.floating[Any]]

    @property
    def count(self) -> int:
        """How many vectors there are."""
        return len(self.vectors)

    def rows(self, rows: slice | NDArray[np.integer]) -> "Placed":
        """Return some of the vectors."""
        return Placed(self.vectors[rows], self.positions[rows])

    def exact(self, rows: slice = slice(None)) -> NDArray[np.float64]:
        """Return some of the vectors with their positions, if these count, as (n, N + 1) float64.

        In float32 positions in a long route would cost a product of the vectors its digits.
        """
        vectors = self.vectors[rows].astype(np.float64)
        return np.column_stack([vectors, self.positions[rows]]) if self.positions[-1] else vectors


def with_route_position(vectors: NDArray[np.float32], weight: float) -> Placed:
    """Give each frame its position in the route.

    At weight 1, the position separates two frames that are 20 apart as far as the descriptors
    separate two random frames (whose mean squared distance is twice the total variance). The
    position counts in frames, so one weight suits routes of every length.

    Args:
        vectors: (K, N) float32 in route order.
        weight: of the position; 0, the paper's clustering, leaves all at position 0.
    """
    numbers = np.arange(len(vectors))
    step = weight * np.sqrt(2 * _total_variance(vectors)) / _RELATED if weight else 0.0
    return Placed(vectors, (step * numbers).astype(np.float32))


def _total_variance(vectors: NDArray[np.float32]) -> np.float64:
    parts = np.array_split(vectors, vectors.shape[1] // _COLUMNS + 1, axis=1)
    variances = [some.var(axis=0, dtype=np.float64) for some in parts]
    return np.float64(np.concatenate(variances).sum())
