"""Squared Euclidean distances between two sets of descriptors."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Real = TypeVar("Real", bound=np.floating[Any])


def squared_distances(rows: NDArray[Real], columns: NDArray[Real]) -> NDArray[Real]:
    """Compute ‖r − c‖² for every row r of rows (A, N) and c of columns (B, N), as (A, B).

    It is expanded to ‖r‖² + ‖c‖² − 2 r·c, so that one matrix product does the work; negative
    rounding errors become 0. Descriptors should be centred: a large common offset costs digits.
    """
    distances: NDArray[Real] = rows @ columns.T
    distances *= -2
    distances += np.einsum("an,an->a", rows, rows)[:, None]
    distances += np.einsum("bn,bn->b", columns, columns)
    np.maximum(distances, 0, out=distances)
    return distances
