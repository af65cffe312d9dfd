"""The backward pass in one frame, on the places that were believed in."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    REACH,
    RESOLVED,
    SPEEDS,
    Array,
    Motion,
    step_likelihoods,
)
from placefield.matching.trace import Transit

Vector = NDArray[np.float64]
Places = NDArray[np.int32]

_FIND, _LOSE, _SHARES, _SPEEDS, _RESOLVED = FIND, LOSE, HYPOTHESES, SPEEDS, RESOLVED


@kernel
def step_back(
    transit: Transit,
    placed: Array,
    lost: Vector,
    apart: Array,
    standing: float,
    motion: Motion,
    before: Places,
    backward: Array,
) -> Vector:
    """Take how likely what follows is from a frame back to the frame before it.

    Args:
        transit: to the frame.
        placed: (n, 2, S) float32, how likely what follows the frame is in each place.
        lost: (S,) float64, likewise when lost.
        apart: (6, K) float32, see ``StepLengths``.
        standing: see there.
        motion: of the vehicle.
        before: (m,) int32, places that were believed in at the frame before.
        backward: (m, 2, S) float32, receives how likely what follows is from each of them.

    Returns:
        The same from being lost at the frame before, (S,). All are in a unit of their greatest.
    """
    count = apart.shape[1]
    to_lost = _LOSE * transit.jump * (motion.prior * lost).sum()
    ahead, found = _weighed(transit, placed, apart, standing)
    adrift = transit.lost_likelihood * ((1 - _FIND) * lost + _FIND / count * found)
    from_lost = adrift + motion.change * ((motion.prior * adrift).sum() - adrift)
    _reach_back(transit, ahead, motion, to_lost, before, backward)
    values = backward.reshape(backward.size)
    top = from_lost.max()
    for i in range(len(values)):
        top = max(top, values[i])
    unit = np.float32(1 / top)
    for i in range(len(values)):
        values[i] *= unit
    return np.asarray(from_lost / top)


@kernel
def _weighed(
    transit: Transit, placed: Array, apart: Array, standing: float
) -> tuple[Array, Vector]:
    """Weigh how likely what follows is by the frame and by the step to it.

    Returns:
        (2, 2, S, n + 1) float32, for who stayed at each place and who has come there, on the map
        and on its reverse, the last one being no place; and the sum over the places for who was
        lost, (S,) float64.
    """
    places, (again, anew) = transit.places, (transit.observed[0], transit.observed[1])
    speeds, count = placed.shape[2], len(places)
    near = np.empty((len(apart), count), np.float32)
    for row in range(len(apart)):
        for i in range(count):
            near[row, i] = apart[row, places[i]]
    steps = np.empty((speeds, count), np.float32)
    step_likelihoods(near, standing, _SPEEDS, transit.step, steps)
    ahead = np.empty((2, 2, speeds, count + 1), np.float32)
    ahead[:, :, :, count] = 0
    found = np.zeros(speeds)
    for speed in range(speeds):
        for hypothesis in range(2):
            stays, comes = ahead[0, hypothesis, speed], ahead[1, hypothesis, speed]
            total = 0.0
            for i in range(count):
                follows = placed[i, hypothesis, speed]
                total += follows * anew[i]
                stays[i] = follows * steps[speed, i] * again[i]
                comes[i] = follows * steps[speed, i] * anew[i]
            found[speed] += _SHARES[hypothesis] * total
    return ahead, found


@kernel
def _reach_back(
    transit: Transit, ahead: Array, motion: Motion, to_lost: float, before: Places, backward: Array
) -> None:
    """Sum over where a vehicle may move to from each place, or else it is lost.

    Args:
        transit: see ``step_back``.
        ahead: see ``_weighed``.
        motion: of the vehicle.
        to_lost: how likely what follows is if it is lost, times the chance of that.
        before: see ``step_back``.
        backward: see there, in no unit.
    """
    speeds, kept, lost = len(motion.prior), np.float32(1 - _LOSE), np.float32(to_lost)
    rows = np.empty((REACH + 1, len(before)), np.uint32)
    reached = np.empty((speeds, len(before)), np.float32)
    mixed = np.empty(len(before), np.float32)
    for hypothesis in range(2):
        _rows_in_reach(transit.places, before, hypothesis, rows)
        mixed[:] = 0
        for speed in range(speeds):
            reached[speed] = 0
            least = motion.least[speed]
            for step in range(least, min(least + 3, REACH + 1)):
                there = ahead[min(step, 1), hypothesis, speed]
                _add(motion.chances[speed, step], there, rows[step], reached[speed])
            _mix(transit.prior[speed], reached[speed], mixed)
        for speed in range(speeds):
            of_speed, change = reached[speed], motion.change[speed]
            for j in range(len(before)):
                value = of_speed[j] + change * (mixed[j] - of_speed[j])
                backward[j, hypothesis, speed] = kept * value + lost


@kernel
def _add(chance: float, there: Array, rows: NDArray[np.uint32], reached: Array) -> None:
    """Add what is reached by one step, with a chance."""
    if chance > 0:
        for j in range(len(reached)):
            reached[j] += chance * there[rows[j]]


@kernel
def _mix(prior: float, reached: Array, mixed: Array) -> None:
    for j in range(len(mixed)):
        mixed[j] += prior * reached[j]


@kernel
def _rows_in_reach(
    places: Places, before: Places, hypothesis: int, rows: NDArray[np.uint32]
) -> None:
    """Write where among n places those are that a step of 0, 1, … from others, (m,), leads to.

    ``rows`` is (REACH + 1, m) uint32; where a step leads to none of them it is n.
    """
    rows[:] = len(places)
    first = 0  # that is in reach of a place; both ascend
    for j in range(len(before)):
        while first < len(places) and places[first] < before[j] - REACH:
            first += 1
        for i in range(first, len(places)):
            away = places[i] - before[j]
            if away > REACH:
                break
            step = away if hypothesis == 0 else -away
            if 0 <= step <= REACH:  # whatever came from other shards, who may not ascend
                rows[step, j] = i


@kernel
def weigh(
    filtered: Array, ahead: Array, filtered_lost: Vector, ahead_lost: Vector, belief: Array
) -> float:
    """Weigh the filter's posterior of a frame by how likely what follows is from each state.

    Args:
        filtered: (n, 2, S) float32, posterior on the map and on its reverse.
        ahead: (n, 2, S) float32, how likely what follows is.
        filtered_lost: (S,) float64, posterior of being lost.
        ahead_lost: (S,) float64, how likely what follows is from there.
        belief: (n,) float32, receives the posterior of each place, at speeds the map resolves.

    Returns:
        Posterior that the vehicle moves faster than that.
    """
    total = (filtered_lost * ahead_lost).sum()
    too_fast = (filtered_lost[_RESOLVED:] * ahead_lost[_RESOLVED:]).sum()
    for i in range(len(filtered)):
        on_map, on_null, faster = np.float32(0), np.float32(0), np.float32(0)
        for speed in range(_RESOLVED):
            on_map += filtered[i, 0, speed] * ahead[i, 0, speed]
            on_null += filtered[i, 1, speed] * ahead[i, 1, speed]
        for speed in range(_RESOLVED, filtered.shape[2]):
            for hypothesis in range(2):
                faster += filtered[i, hypothesis, speed] * ahead[i, hypothesis, speed]
        belief[i] = on_map
        total += on_map + on_null + faster
        too_fast += faster
    for i in range(len(belief)):
        belief[i] = np.float32(belief[i] / total)
    return float(min(too_fast / total, 1.0))
