"""Compiled loops that read the filter's beliefs, and that predict those of a lost vehicle.

Each does what numpy could do in a dozen calls, which would take longer than the arithmetic.
"""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, pairwise_sum, sum_of
from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    RESOLVED,
    Array,
    StepLengths,
    mean_student,
    step_likelihood,
)
from placefield.matching.trace import MOST_PLACES, NEGLIGIBLE

Vector = NDArray[np.float64]
Places = NDArray[np.int32]

_FIND, _LOSE, _HYPOTHESES, _RESOLVED = FIND, LOSE, HYPOTHESES, RESOLVED
_NEGLIGIBLE, _MOST_PLACES = NEGLIGIBLE, MOST_PLACES


@kernel
def pick(values: Array, least: float) -> Places:
    """Return the ascending indices of values (K,) that are at least so great, (n,) int32."""
    picked = np.empty(len(values), np.int32)
    count, threshold = 0, np.float32(least)
    for i in range(len(values)):
        if values[i] >= threshold:
            picked[count] = i
            count += 1
    return picked[:count].copy()


@kernel
def likeliest(belief: Array, total: float) -> Places:
    """Return the places whose belief, (K,), is not a negligible part of a total, ascending.

    There are ``MOST_PLACES`` at most, those of most belief. If no belief counts, the likeliest.
    """
    places = pick(belief, _NEGLIGIBLE * total)
    if len(places) == 0:
        places = pick(belief, float(belief.max()))
    if len(places) <= _MOST_PLACES:
        return places
    return places[_greatest(belief[places], _MOST_PLACES)]


@kernel
def _greatest(values: Array, most: int) -> NDArray[np.intp]:
    """Return the ascending rows of the greatest of values (n,), so many; of equals the first.

    No value is negative, so their bits have their order. The least of the greatest is found bit by
    bit: to compile a sort would take seconds.
    """
    bits, least = values.view(np.int32), 0
    for bit in range(30, -1, -1):
        if _count_from(bits, least | 1 << bit) >= most:
            least |= 1 << bit
    equal = most - _count_from(bits, least + 1)
    rows, count = np.empty(most, np.intp), 0
    for row in range(len(bits)):
        if bits[row] > least or (bits[row] == least and equal > 0):
            equal -= bits[row] == least
            rows[count] = row
            count += 1
    return rows[:count]


@kernel
def _count_from(values: Places, least: int) -> int:
    """Return how many of values (n,) are at least so great."""
    count = 0
    for i in range(len(values)):
        count += values[i] >= least
    return count


@kernel
def at_likeliest(
    belief: Array, by_place: Array, by_speed: Vector, evidence: Array
) -> tuple[Places, Array, Array]:
    """Return the places of a shard whose belief may count in the whole map.

    Args:
        belief: (2, S, K) float32.
        by_place: (2, K) float32, its sums over the speeds.
        by_speed: (2, S) float64, its sums over the places.
        evidence: (K,) float32, see ``Observation``.

    Returns:
        The places, (n,) int32, and their evidence, (n,), and beliefs, (n, 2, S) float32.
    """
    places = likeliest(by_place[0] + by_place[1], pairwise_sum(by_speed.ravel()))
    hypotheses, speeds, _ = belief.shape
    there = np.empty((len(places), hypotheses, speeds), np.float32)
    for hypothesis in range(hypotheses):
        for speed in range(speeds):
            row = belief[hypothesis, speed]
            for i in range(len(places)):
                there[i, hypothesis, speed] = row[places[i]]
    return places, evidence[places], there


@kernel
def normalise(
    places: Places, belief: Array, evidence: Array, total: float
) -> tuple[Places, Array, Array]:
    """Divide beliefs by their total, and leave out the places whose belief is then negligible.

    Args:
        places: (n,) int32.
        belief: (n, 2, S) float32.
        evidence: (n,) float32.
        total: of the beliefs in all places, and of being lost.

    Returns:
        The same three, of the places that are left.
    """
    by_place, divisor = np.empty(len(places), np.float32), np.float32(total)
    for i in range(len(places)):
        of_place = np.float32(0)
        for hypothesis in range(belief.shape[1]):
            for speed in range(belief.shape[2]):
                of_place += belief[i, hypothesis, speed] / divisor
        by_place[i] = of_place
    kept = likeliest(by_place, 1.0)
    return places[kept], belief[kept] / divisor, evidence[kept]


@kernel
def sums_of(by_speed: Vector, lost: Vector) -> tuple[float, float, float]:
    """Return the total belief, that on the map, and that at speeds the map does not resolve.

    Args:
        by_speed: (2, S) float64, belief on the map and on its reverse, at each speed.
        lost: (S,) float64, belief of being lost.
    """
    total = pairwise_sum(by_speed.ravel()) + pairwise_sum(lost)
    too_fast = pairwise_sum(by_speed[:, _RESOLVED:].copy().ravel())
    return total, pairwise_sum(by_speed[0]), too_fast + pairwise_sum(lost[_RESOLVED:])


@kernel
def resolve(belief: Array, by_place: Array, total: float) -> tuple[Array, int]:
    """Return the posterior of places at speeds that the map resolves, (K,), and the likeliest.

    Args:
        belief: (2, S, K) float32.
        by_place: (2, K) float32, its sums over the speeds.
        total: of all beliefs.
    """
    posterior, divisor = by_place[0].copy(), np.float32(total)
    for speed in range(_RESOLVED, belief.shape[1]):
        too_fast = belief[0, speed]
        for i in range(len(posterior)):
            posterior[i] -= too_fast[i]
    for i in range(len(posterior)):
        posterior[i] = max(posterior[i], np.float32(0)) / divisor
    best = 0
    for i in range(len(posterior)):
        if posterior[i] > posterior[best]:
            best = i
    return posterior, best


@kernel
def at_ends(belief: Array, reach: int) -> Array:
    """Return the beliefs in the last places on the map and the first on its reverse, (2, S, n).

    They are 0 where a shard has fewer than n places.
    """
    _, speeds, count = belief.shape
    ends = np.zeros((2, speeds, reach), np.float32)
    for speed in range(speeds):
        for i in range(min(reach, count)):
            ends[0, speed, reach - 1 - i] = belief[0, speed, count - 1 - i]
            ends[1, speed, i] = belief[1, speed, i]
    return ends


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
def predict_lost(
    lost: Vector, change: Array, unlearned: Vector, likelihoods: tuple[Vector, float], places: int
) -> tuple[Array, Vector]:
    """Predict the belief of a vehicle that was lost, and weight it by the observed step.

    It keeps its speed for a while, as a vehicle on the map does.

    Args:
        lost: (S,) float64, posterior of being lost, at each speed.
        change: (S,) float32, chance that the speed changes.
        unlearned: (S,) float64, chance of each speed then, and after a jump.
        likelihoods: of the step, see ``step_likelihood_when_lost``.
        places: of the map.

    Returns:
        See ``find_and_lose``.
    """
    lost_likelihood, jump_likelihood = likelihoods
    changed = (change * lost).sum()
    still_lost = ((1 - change) * lost + unlearned * changed) * lost_likelihood
    jumped = jump_likelihood * (1 - pairwise_sum(lost)) * unlearned
    return find_and_lose(still_lost, jumped, places)


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
