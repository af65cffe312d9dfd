"""A filter shard's partial result, and its encoding as a vector."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import REACH, SPEEDS, Array

Vector = NDArray[np.float64]

_SPEEDS = len(SPEEDS)
_HALO = 2 * _SPEEDS * REACH
_HEAD = 2 + 2 * _SPEEDS + _HALO
_ROW = 2 + 2 * _SPEEDS  # of each place: its evidence, its number and its beliefs


class FilterPartial(NamedTuple):
    """A shard's partial result for a frame.

    Attributes:
        predicted: sum of the beliefs on the map before the update.
        expected: sum of these beliefs, each times the likelihood ratio of its place to being lost.
        by_speed: (2, S) float64, sums of the beliefs at each speed, on the map and its reverse.
        halo: (2, S, REACH) float32, beliefs from where the vehicle may leave the shard: of the last
            places on the map, and of the first on its reverse.
        places: (n,) int32, places of the map that may be in the frame's trace.
        evidence: (n,) float32, see ``Observation``.
        belief: (n, 2, S) float32, at these places.
    """

    predicted: float
    expected: float
    by_speed: Vector
    halo: Array
    places: NDArray[np.int32]
    evidence: Array
    belief: Array


def pack(partial: FilterPartial) -> NDArray[np.float64]:
    """Return a partial result as a vector, (n,) float64."""
    sums = (partial.predicted, partial.expected)
    rows = np.column_stack(
        [partial.evidence, partial.places, partial.belief.reshape(-1, 2 * _SPEEDS)]
    )
    return np.concatenate([sums, partial.by_speed.ravel(), partial.halo.ravel(), rows.ravel()])


def unpack(vector: NDArray[np.float64]) -> FilterPartial:
    """Return the partial result in a vector that ``fits``."""
    predicted, expected = vector[:2].tolist()
    by_speed, halo = vector[2 : 2 + 2 * _SPEEDS], vector[2 + 2 * _SPEEDS : _HEAD]
    rows = vector[_HEAD:].reshape(-1, _ROW)
    return FilterPartial(
        predicted,
        expected,
        by_speed.reshape(2, _SPEEDS),
        halo.astype(np.float32).reshape(2, _SPEEDS, REACH),
        rows[:, 1].astype(np.int32),
        rows[:, 0].astype(np.float32),
        rows[:, 2:].astype(np.float32).reshape(-1, 2, _SPEEDS),
    )


def fits(vector: NDArray[np.float64], places: int) -> bool:
    """Whether a vector from another process may be a partial result of a map of K places."""
    if len(vector) < _HEAD or (len(vector) - _HEAD) % _ROW:
        return False
    rows = vector[_HEAD:].reshape(-1, _ROW)
    if (vector[:_HEAD] < 0).any() or (rows[:, 1:] < 0).any():
        return False
    numbers = rows[:, 1]
    return bool(np.all(numbers < places) and np.all(np.diff(numbers) > 0))
