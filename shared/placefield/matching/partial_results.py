"""A filter shard's partial result as one vector, as it travels between the shards."""

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import REACH, SPEEDS
from placefield.matching.place_filter import Share

_SPEEDS = len(SPEEDS)
_HALO = 2 * _SPEEDS * REACH
_HEAD = 5 + 2 * _SPEEDS + _HALO
_ROW = 2 + 2 * _SPEEDS  # of each place: its evidence, its number and its beliefs


def pack(share: Share) -> NDArray[np.float64]:
    """Return a partial result as a vector, (n,) float64."""
    sums = (share.nearest, share.likelihood, share.predicted, share.expected)
    rows = np.column_stack([share.evidence, share.places, share.belief.reshape(-1, 2 * _SPEEDS)])
    return np.concatenate(
        [
            [share.lost_log_likelihood],
            sums,
            share.of_speed.ravel(),
            share.halo.ravel(),
            rows.ravel(),
        ]
    )


def unpack(vector: NDArray[np.float64]) -> Share:
    """Return the partial result that was packed; the vector fits."""
    lost, nearest, likelihood, predicted, expected = vector[:5].tolist()
    of_speed, halo = vector[5 : 5 + 2 * _SPEEDS], vector[5 + 2 * _SPEEDS : _HEAD]
    rows = vector[_HEAD:].reshape(-1, _ROW)
    return Share(
        int(nearest),
        lost,
        likelihood,
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
    if (vector[1:_HEAD] < 0).any() or (rows[:, 1:] < 0).any():
        return False
    numbers = rows[:, 1]
    return bool(np.all(numbers < places) and np.all(np.diff(numbers) > 0))
