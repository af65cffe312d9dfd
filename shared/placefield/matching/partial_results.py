"""A filter shard's partial result: what it is, how those of all are joined, how it travels."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import COUNT_OF, REACH, SPEEDS, Array

Vector = NDArray[np.float64]

_SPEEDS = len(SPEEDS)
_HALO = 2 * _SPEEDS * REACH
_HEAD = 5 + 2 * _SPEEDS + _HALO
_ROW = 2 + 2 * _SPEEDS  # of each place: its evidence, its number and its beliefs


class Share(NamedTuple):
    """A shard's partial result for a frame.

    Its beliefs and evidence are against what the shard takes for the log likelihood when lost.

    Attributes:
        nearest: see ``Observation``.
        lost_log_likelihood: of the frame when lost, by these places, less that at the nearest.
        likelihood: sum of the places' likelihoods, in terms of that at the nearest.
        predicted: sum of the beliefs on the map before the update, a probability.
        expected: sum of these times the places' likelihoods.
        of_speed: (2, S) float64, sums of the beliefs at each speed, on the map and its reverse.
        halo: (2, S, REACH) float32, beliefs of the last places on the map and of the first on its
            reverse, from where the vehicle may leave the shard.
        places: (n,) int32, of the map, that may be in the frame's trace.
        evidence: (n,) float32, see ``Trace``.
        belief: (n, 2, S) float32, in them.
    """

    nearest: int
    lost_log_likelihood: float
    likelihood: float
    predicted: float
    expected: float
    of_speed: Vector
    halo: Array
    places: NDArray[np.int32]
    evidence: Array
    belief: Array


class Joined(NamedTuple):
    """What the shards have together, and what each takes for it without the others.

    Attributes:
        likelihood: mean of all places, in terms of that at the nearest of all.
        expected: sum of the beliefs on the map before the update times their likelihoods, likewise.
        shortfalls: of each shard, nats by which its evidence against being lost is too little.
        factors: (S,) float64 of each, by which its beliefs are too small.
    """

    likelihood: float
    expected: float
    shortfalls: list[float]
    factors: list[Vector]


def joined(
    shares: Sequence[Share],
    all_places: int,
    inverse_temperature: float,
    lost_evidence: float,
    counts: Vector,
) -> Joined:
    """Join the partial results of all shards of a frame.

    Args:
        shares: in the order of their places.
        all_places: number of these.
        inverse_temperature: see ``Observation``.
        lost_evidence: see there.
        counts: (R,) float64, how much of evidence counts, see ``COUNTS``.
    """
    nearest = min(share.nearest for share in shares)
    # Nats by which a frame is less likely at the shard's nearest place than at that of all.
    less = [0.5 * (share.nearest - nearest) * inverse_temperature for share in shares]
    units = [math.exp(-nats) for nats in less]
    both = list(zip(units, shares, strict=True))
    likelihood = sum(unit * share.likelihood for unit, share in both) / all_places
    lost = math.log(likelihood) + lost_evidence
    shortfalls = [
        share.lost_log_likelihood - nats - lost for nats, share in zip(less, shares, strict=True)
    ]
    return Joined(
        likelihood,
        sum(unit * share.expected for unit, share in both),
        shortfalls,
        [np.exp(counts * nats)[COUNT_OF] for nats in shortfalls],
    )


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
