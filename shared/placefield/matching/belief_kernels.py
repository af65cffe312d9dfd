"""Compiled loops that read the filter's beliefs, and that predict those of a lost vehicle."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    Array,
    StepLengths,
    mean_student,
    step_likelihood,
)

Vector = NDArray[np.float64]
Places = NDArray[np.int32]

_FIND, _LOSE, _HYPOTHESES = FIND, LOSE, HYPOTHESES


@kernel
def pick(values: Array, least: float, picked: Places) -> int:
    """Write the ascending indices of values (K,) that are at least so great; return how many."""
    count, threshold = 0, np.float32(least)
    for i in range(len(values)):
        if values[i] >= threshold:
            picked[count] = i
            count += 1
    return count


@kernel
def beliefs_at(belief: Array, places: Places) -> Array:
    """Return the beliefs (2, S, K) float32 in n places, (n, 2, S)."""
    hypotheses, speeds, _ = belief.shape
    there = np.empty((len(places), hypotheses, speeds), np.float32)
    for hypothesis in range(hypotheses):
        for speed in range(speeds):
            row = belief[hypothesis, speed]
            for i in range(len(places)):
                there[i, hypothesis, speed] = row[places[i]]
    return there


@kernel
def normalise(belief: Array, total: float) -> Array:
    """Divide beliefs (n, 2, S) float32 by their total, and return their sums by place, (n,)."""
    sums = np.empty(len(belief), np.float32)
    divisor = np.float32(total)
    for i in range(len(belief)):
        total_of_place = np.float32(0)
        for hypothesis in range(belief.shape[1]):
            for speed in range(belief.shape[2]):
                normalised = belief[i, hypothesis, speed] / divisor
                belief[i, hypothesis, speed] = normalised
                total_of_place += normalised
        sums[i] = total_of_place
    return sums


@kernel
def resolve(by_place: Array, too_fast: Array, total: float, posterior: Array) -> int:
    """Write the posterior of places at speeds that the map resolves; return the likeliest place.

    Args:
        by_place: (K,) float32, sums of the beliefs over all speeds.
        too_fast: (n, K) float32, beliefs at the speeds that the map does not resolve.
        total: of all beliefs.
        posterior: (K,) float32, receives it.
    """
    divisor = np.float32(total)
    for i in range(len(posterior)):
        resolved = by_place[i]
        for speed in range(len(too_fast)):
            resolved -= too_fast[speed, i]
        posterior[i] = max(resolved, np.float32(0)) / divisor
    best = 0
    for i in range(len(posterior)):
        if posterior[i] > posterior[best]:
            best = i
    return best


@kernel
def step_likelihood_when_lost(
    lengths: StepLengths, speeds: Vector, step: float
) -> tuple[Vector, float]:
    """Return the likelihood of a step for a vehicle that stays lost, (S,), and for one that jumps.

    Args:
        lengths: of steps on the map.
        speeds: (S,) float64, places per frame.
        step: its length; ``UNKNOWN`` has likelihood 1.
    """
    lost_likelihood, jump = np.ones(len(speeds)), 1.0
    if step < 0:
        return lost_likelihood, jump
    sample = np.empty(lengths.sample.shape[1], np.float32)
    for speed in range(len(speeds)):
        step_likelihood(lengths.sample, 0, lengths.stationary, speeds[speed], step, sample)
        lost_likelihood[speed] = sum_of(sample) / len(sample)
    return lost_likelihood, mean_student(lengths.random_pairs, step)


@kernel
def predict_lost(lost: Vector, change: Array, unlearned: Vector, lost_likelihood: Vector) -> Vector:
    """Predict the speed, (S,), of a vehicle that was lost, and weight it by the observed step.

    It keeps its speed for a while, as a vehicle on the map does.

    Args:
        lost: (S,) float64, posterior of being lost, at each speed.
        change: (S,) float32, chance that the speed changes.
        unlearned: (S,) float64, chance of each speed then.
        lost_likelihood: (S,) float64, likelihood of the step.
    """
    changed = (change * lost).sum()
    return np.asarray(((1 - change) * lost + unlearned * changed) * lost_likelihood)


@kernel
def find_and_lose(still_lost: Vector, jumped: Vector, places: int) -> tuple[Array, Vector]:
    """Move some belief from lost to the map, and some from the map to lost.

    Args:
        still_lost: (S,) float64, belief of a vehicle that was lost, at each speed.
        jumped: (S,) float64, belief of a vehicle that was on the map, times the likelihood of a
            jump.
        places: of the map.

    Returns:
        (2, S) float32, belief that is found in each place, on the map and its reverse; (S,), belief
        that is lost.
    """
    found = np.empty((len(_HYPOTHESES), len(still_lost)), np.float32)
    for hypothesis in range(len(_HYPOTHESES)):
        for speed in range(len(still_lost)):
            found[hypothesis, speed] = _HYPOTHESES[hypothesis] * _FIND * still_lost[speed] / places
    return found, np.asarray((1 - _FIND) * still_lost + _LOSE * jumped)
