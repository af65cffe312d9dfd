"""The published rule as its equations say it, with nothing remembered from frame to frame."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Scored = tuple[float, int]


def literal_match(
    window: Array, channels: Sequence[tuple[Array, Array]], scales: Sequence[int]
) -> int:
    """Match the newest frame of a window by Eqs. 5 to 16.

    Args:
        window: (s_c, N) descriptors of the last frames, as many as the longest scale.
        channels: of each, the projection v (N, N) and the descriptors of the places (K, N).
        scales: frames, ascending.

    Returns:
        The place.
    """
    return min(_candidate(window, v, places, scales) for v, places in channels)[1]  # Eq. 16


def _candidate(window: Array, v: Array, places: Array, scales: Sequence[int]) -> Scored:
    distances = _distances(window, v, places)
    return min(_hypothesis(distances, scales[0], coarse) for coarse in scales[1:])  # Eq. 15


def _distances(window: Array, v: Array, places: Array) -> NDArray[np.float64]:
    """Eqs. 5 to 7, of all frames of the window to all places."""
    metric = v.T @ v
    distances = np.empty((len(window), len(places)))
    for j, place in enumerate(places):
        offsets = window - place
        distances[:, j] = ((offsets @ metric) * offsets).sum(axis=1)
    return distances


def _hypothesis(distances: NDArray[np.float64], smallest: int, coarse: int) -> Scored:
    """Eqs. 11 to 14."""
    field = _best(distances, coarse, range(distances.shape[1] - coarse + 1))[1]
    score, start = _best(distances, smallest, range(field, field + coarse - smallest + 1))
    return score, start + smallest - 1


def _best(distances: NDArray[np.float64], length: int, starts: range) -> Scored:
    first = len(distances) - length
    return min(
        (sum(distances[first + i, start + i] for i in range(length)), start) for start in starts
    )
