"""Fewer rows for a learned projection: a frame is then compared in fewer dimensions."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Labels = NDArray[np.integer[Any]]


def reduce_rank(projection: Array, descriptors: Array, labels: Labels, kept: float) -> Array:
    """Return the projection onto the fewest axes that keep the distances between segments.

    The axes are the principal ones of the offsets between projected frames of different segments.
    The offsets of all pairs of K frames have the scatter K Σ x xᵀ, x centred. Those of the pairs
    within a segment of n frames have n Σ x xᵀ, x centred in the segment, and are taken away.

    Args:
        projection: (M, N) float32.
        descriptors: (K, N) float32.
        labels: (K,) int, equal for frames of one segment.
        kept: the part of the sum of squared distances that is kept, above 0; with 1 the projection
            stays as it is.

    Returns:
        (R, N) float32, R ≤ M. All frames of one segment leave the projection as it is, too.
    """
    if kept == 1:
        return projection
    scatter = _scatter(descriptors) * len(descriptors)
    for label in np.unique(labels):
        segment = descriptors[labels == label]
        scatter -= _scatter(segment) * len(segment)
    under = projection.astype(np.float64)
    squares, axes = np.linalg.eigh(under @ scatter @ under.T)
    so_far = np.cumsum(squares[::-1])
    if so_far[-1] <= 0:
        return projection
    rank = int(np.searchsorted(so_far, kept * so_far[-1])) + 1
    return np.asarray(axes[:, : -rank - 1 : -1].T @ under, np.float32)


def _scatter(vectors: Array) -> NDArray[np.float64]:
    centred = vectors - vectors.mean(axis=0, dtype=np.float64)
    return np.asarray(centred.T @ centred)
