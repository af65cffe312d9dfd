"""A filter shard's partial result: what it is, and how it travels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import REACH, SPEEDS, Array

Vector = NDArray[np.float64]

_SPEEDS = len(SPEEDS)
_HALO = 2 * _SPEEDS * REACH
_HEAD = 2 + 2 * _SPEEDS + _HALO
_ROW = 2 + 2 * _SPEEDS  # of each place: its evidence, its number and its beliefs


class Share(NamedTuple):
    """A shard's partial result for a frame.

    Attributes:
        predicted: sum of the beliefs on the map before the update.
        expected: sum of these times the places' likelihoods, in terms of that when lost.
        of_speed: (2, S) float64, sums of the beliefs at each speed, on the map and its reverse.
        halo: (2, S, REACH) float32, beliefs of the last places on the map and of the first on its
            reverse, from where the vehicle may leave the shard.
        places: (n,) int32, of the map, that may be in the frame's trace.
        evidence: (n,) float32, see ``Trace``.
        belief: (n, 2, S) float32, in them.
    """

    predicted: float
    expected: float
    of_speed: Vector
    halo: Array
    places: NDArray[np.int32]
    evidence: Array
    belief: Array


def pack(share: Share) -> NDArray[np.float64]:
    """Return a partial result as a vector, (n,) float64."""
    sums = (share.predicted, share.expected)
    rows = np.column_stack([share.evidence, share.places, share.belief.reshape(-1, 2 * _SPEEDS)])
    return np.concatenate([sums, share.of_speed.ravel(), share.halo.ravel(), rows.ravel()])


def unpack(vector: NDArray[np.float64]) -> Share:
    """Return the partial result that was packed; the vector fits."""
    predicted, expected = vector[:2].tolist()
    of_speed, halo = vector[2 : 2 + 2 * _SPEEDS], vector[2 + 2 * _SPEEDS : _HEAD]
    rows = vector[_HEAD:].reshape(-1, _ROW)
    return Share(
        predicted,
        expected,
        of_speed.reshape(2, _SPEEDS),
        halo.astype(np.float32).reshape(2, _SPEEDS, REACH),
        rows[:, 1].astype(np.int32),
        rows[:, 0].astype(np.float32),
        rows[:, 2:].astype(np.float32).reshape(-1, 2, _SPEEDS),
    )


def fits(vector: NDArray[np.float64], places: int) -> bool:
    """Whether a vector that comes from elsewhere may be a partial result of a map of K places."""
    if len(vector) < _HEAD or (len(vector) - _HEAD) % _ROW:
        return False
    rows = vector[_HEAD:].reshape(-1, _ROW)
    if (vector[:_HEAD] < 0).any() or (rows[:, 1:] < 0).any():
        return False
    numbers = rows[:, 1]
    return bool(np.all(numbers < places) and np.all(np.diff(numbers) > 0))
