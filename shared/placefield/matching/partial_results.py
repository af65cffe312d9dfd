"""A filter shard's partial result as one vector, as it travels between the shards."""

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import REACH, SPEEDS
from placefield.matching.place_filter import Share

_SPEEDS = len(SPEEDS)
_HALO = 2 * _SPEEDS * REACH
_HEAD = 4 + _SPEEDS + _HALO
_ROW = 2 + 2 * _SPEEDS  # of each place: its number, its likelihood and its beliefs


def pack(share: Share) -> NDArray[np.float64]:
    """Return a partial result as a vector, (n,) float64."""
    sums = (share.nearest, share.predicted, share.likelihood, share.of_null)
    rows = np.column_stack(
        [share.places, share.place_likelihood, share.belief.reshape(len(share.places), -1)]
    )
    return np.concatenate([sums, share.of_speed, share.halo.ravel(), rows.ravel()])


def unpack(vector: NDArray[np.float64]) -> Share:
    """Return the partial result that was packed; the vector fits."""
    nearest, predicted, likelihood, of_null = vector[:4].tolist()
    of_speed, halo = vector[4 : 4 + _SPEEDS], vector[4 + _SPEEDS : _HEAD]
    rows = vector[_HEAD:].reshape(-1, _ROW)
    return Share(
        int(nearest),
        predicted,
        likelihood,
        of_null,
        of_speed,
        halo.astype(np.float32).reshape(2, _SPEEDS, REACH),
        rows[:, 0].astype(np.int32),
        rows[:, 1].astype(np.float32),
        rows[:, 2:].astype(np.float32).reshape(-1, 2, _SPEEDS),
    )


def fits(vector: NDArray[np.float64], places: int) -> bool:
    """Whether a vector that comes from elsewhere may be a partial result of a map of K places."""
    if len(vector) < _HEAD or (len(vector) - _HEAD) % _ROW or (vector < 0).any():
        return False
    numbers = vector[_HEAD::_ROW]
    return bool(np.all(numbers < places) and np.all(np.diff(numbers) > 0))
