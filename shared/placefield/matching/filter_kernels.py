"""The filter's predict and update in one pass over its beliefs, and what is picked from them."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.motion import REACH, SPEEDS, Array, Motion, step_likelihoods

_BLOCK = 1024  # places whose beliefs stay in the cache from one loop to the next
_SPEEDS = SPEEDS  # as a constant of compiled code


class Transition(NamedTuple):
    """From one frame to the next.

    Attributes:
        motion: of the vehicle.
        prior: (S,) float32, chance of each speed after a change.
        kept: what beliefs are multiplied by.
        found: (2, S) float32, probability of each place at each speed, on the map and its reverse,
            of a vehicle that was lost.
        step: length of the step, in descriptor space; ``UNKNOWN`` if it is not known.
        standing: length of no step.
    """

    motion: Motion
    prior: Array
    kept: float
    found: Array
    step: float
    standing: float


@kernel
def advance(
    belief: Array,
    halo: Array,
    transition: Transition,
    apart: Array,
    seen: Array,
    likelihood: Array,
    of_place: Array,
    of_speed: NDArray[np.float64],
) -> tuple[float, float]:
    """Predict the beliefs in K places from those of the frame before, and update them.

    Args:
        belief: (2, S, K) float32, on the map and on its reverse, which is driven the other way;
            receives the beliefs after the frame.
        halo: (2, S, REACH) float32, beliefs, times ``kept``, in the places before these on the map,
            and in those after them on its reverse.
        transition: from the frame before to this one.
        apart: (6, K) float32, see ``StepLengths``.
        seen: (2, K) float32, by how much likelier what was observed is at each place than when
            lost, for a vehicle that was there already, and for one that has come there.
        likelihood: (K,) float32, the same if all of the evidence counts.
        of_place: (2, K) float32, receives the sums over the speeds.
        of_speed: (2, S) float64, receives the sums over the places.

    Returns:
        The sum of the beliefs on the map before the update, and that of each times its likelihood.
    """
    motion, places = transition.motion, belief.shape[2]
    speeds = len(motion.prior)
    changed = np.empty(_BLOCK + REACH, np.float32)
    moving = np.empty(_BLOCK + 2 * REACH, np.float32)
    arrived, predicted = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    expected = np.empty(_BLOCK, np.float32)
    steps = np.empty((speeds, _BLOCK), np.float32)
    # What lies before a block has been overwritten when its turn comes, and is kept here.
    before = _mixed_halo(halo, transition)
    after_all = before[1].copy()
    total, of_likelihood = 0.0, 0.0
    of_speed[:] = 0
    for start in range(0, places, _BLOCK):
        end = min(start + _BLOCK, places)
        size = end - start
        step_likelihoods(
            apart[:, start:end], transition.standing, _SPEEDS, transition.step, steps[:, :size]
        )
        for hypothesis in range(2):
            reached = min(size + REACH, places - start)
            _sum_changes(belief[hypothesis, :, start : start + reached], motion.change, changed)
            predicted[:size], of_place[hypothesis, start:end] = 0, 0
            for speed in range(speeds):
                stay = np.float32(transition.kept) * (np.float32(1) - motion.change[speed])
                join = np.float32(transition.kept) * transition.prior[speed]
                moving[:REACH] = before[hypothesis, speed]
                ahead = belief[hypothesis, speed, start : start + reached]
                for i in range(reached):
                    moving[REACH + i] = stay * ahead[i] + join * changed[i]
                moving[REACH + reached : size + 2 * REACH] = after_all[
                    speed, : size + REACH - reached
                ]
                before[hypothesis, speed] = moving[size : size + REACH]
                _come(moving, motion.chances[speed], hypothesis == 0, arrived[:size])
                stays = motion.chances[speed, 0]
                found, after = transition.found[hypothesis, speed], ahead[:size]
                again, anew, sums = seen[0], seen[1], of_place[hypothesis]
                for i in range(size):
                    stayed = stays * moving[REACH + i] * steps[speed, i]
                    came = arrived[i] * steps[speed, i] + found
                    predicted[i] += stayed + came
                    after[i] = stayed * again[start + i] + came * anew[start + i]
                    sums[start + i] += after[i]
                of_speed[hypothesis, speed] += sum_of(after)
            if hypothesis == 0:
                for i in range(size):
                    expected[i] = predicted[i] * likelihood[start + i]
                total += sum_of(predicted[:size])
                of_likelihood += sum_of(expected[:size])
    return total, of_likelihood


@kernel
def _mixed_halo(halo: Array, transition: Transition) -> Array:
    """Change the speeds of the beliefs outside as ``advance`` does those inside."""
    mixed = np.empty_like(halo)
    changed = np.empty(REACH, np.float32)
    change = transition.motion.change
    for hypothesis in range(len(halo)):
        _sum_changes(halo[hypothesis], change, changed)
        for speed in range(len(change)):
            stay, join = np.float32(1) - change[speed], transition.prior[speed]
            mixed[hypothesis, speed] = stay * halo[hypothesis, speed] + join * changed
    return mixed


@kernel
def _sum_changes(belief: Array, change: Array, changed: Array) -> None:
    """Sum over the speeds what leaves each of them."""
    changed[:] = 0
    for speed in range(len(change)):
        factor = change[speed]
        for i in range(belief.shape[1]):
            changed[i] += factor * belief[speed, i]


@kernel
def _come(moving: Array, chances: Array, is_map: bool, arrived: Array) -> None:
    """Sum what comes to places from those up to REACH before them, or after on the reverse."""
    arrived[:] = 0
    for step in range(1, REACH + 1):
        chance = chances[step]
        if chance > 0:
            start = REACH - step if is_map else REACH + step
            for i in range(len(arrived)):
                arrived[i] += chance * moving[start + i]


@kernel
def nearness(distances: NDArray[np.int32], near: NDArray[np.int32]) -> None:
    """Write twice the squared distance of places (K,) from a frame.

    It is the mean of a place's own and the least of its own and its two neighbours': from a frame
    that was taken between two places both are far.

    Args:
        distances: (K + 2,) int32, squared; the first and the last belong to neighbours.
        near: (K,) int32, receives it.
    """
    for i in range(len(near)):
        around = min(distances[i], distances[i + 1], distances[i + 2])
        near[i] = np.int32(distances[i + 1] + around)


@kernel
def pick(values: Array, least: float, picked: NDArray[np.int32]) -> int:
    """Write the indices of values (K,) of at least so much, ascending; return how many."""
    count, threshold = 0, np.float32(least)
    for i in range(len(values)):
        if values[i] >= threshold:
            picked[count] = i
            count += 1
    return count


@kernel
def step_length(codes: NDArray[np.int16], last: NDArray[np.int16], unit: float) -> float:
    """How far apart two vectors of codes are."""
    squares = np.int32(0)
    for m in range(len(codes)):
        difference = np.int32(np.int32(codes[m]) - np.int32(last[m]))
        squares = np.int32(squares + np.int32(difference * difference))
    return unit * math.sqrt(squares)
