"""The filter's predict and update in one pass over its beliefs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.motion import REACH, SPEEDS, Array, Motion, step_likelihood

_BLOCK = 1024  # places whose beliefs stay in the cache from one loop to the next
_LANES = 128  # sums side by side, of a block
_SPEEDS = SPEEDS  # as a constant of compiled code

Vector = NDArray[np.float64]


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


class _Block(NamedTuple):
    """A block of places, and memory for what is computed of it.

    Attributes:
        first: of its places.
        size: how many they are.
        steps: (S, _BLOCK) float32, likelihood of the step by the place it leads to.
        changed: (_BLOCK + REACH,) float32, chance that the speed changes, here and ahead.
        moving: (_BLOCK + 2 * REACH,) float32, beliefs at one speed, from before to ahead.
        predicted: (_BLOCK,) float32, beliefs before the update, at all speeds.
    """

    first: int
    size: int
    steps: Array
    changed: Array
    moving: Array
    predicted: Array


@kernel
def advance(
    belief: Array,
    halo: Array,
    transition: Transition,
    apart: Array,
    observed: Array,
    likelihood: Array,
    of_place: Array,
    of_speed: Vector,
) -> tuple[float, float]:
    """Predict the beliefs in K places from those of the frame before, and update them.

    Args:
        belief: (2, S, K) float32, on the map and on its reverse, which is driven the other way;
            receives the beliefs after the frame.
        halo: (2, S, REACH) float32, beliefs, times ``kept``, in the places before these on the map,
            and in those after them on its reverse.
        transition: from the frame before to this one.
        apart: (6, K) float32, see ``StepLengths``.
        observed: (2, K) float32, by how much likelier what was observed is at each place than when
            lost, for a vehicle that was there already, and for one that has come there.
        likelihood: (K,) float32, the same if all of the evidence counts.
        of_place: (2, K) float32, sums of the beliefs over the speeds; receives them.
        of_speed: (2, S) float64, receives the sums over the places.

    Returns:
        The sum of the beliefs on the map before the update, and that of each times its likelihood.
    """
    places, speeds = belief.shape[2], len(transition.prior)
    steps = np.empty((speeds, _BLOCK), np.float32)
    changed = np.empty(_BLOCK + REACH, np.float32)
    moving = np.empty(_BLOCK + 2 * REACH, np.float32)
    predicted = np.empty(_BLOCK, np.float32)
    # What lies before a block has been overwritten when its turn comes, and is kept here.
    before = _mixed_halo(halo, transition)
    after_all = before[1].copy()
    total, of_likelihood = 0.0, 0.0
    of_speed[:] = 0
    for first in range(0, places, _BLOCK):
        size = min(_BLOCK, places - first)
        block = _Block(first, size, steps, changed, moving, predicted)
        for speed in range(speeds):
            likelihoods, places_per_frame = steps[speed, :size], _SPEEDS[speed]
            step_likelihood(
                apart, first, transition.standing, places_per_frame, transition.step, likelihoods
            )
        for hypothesis in range(2):
            sides = before[hypothesis], after_all
            own, sums = belief[hypothesis], of_place[hypothesis]
            _advance_block(
                block, own, sides, transition, hypothesis, observed, sums, of_speed[hypothesis]
            )
            if hypothesis == 0:
                total += _sum_of_block(predicted[:size])
                _multiply(predicted[:size], likelihood[first : first + size])
                of_likelihood += _sum_of_block(predicted[:size])
    return total, of_likelihood


@kernel
def _advance_block(
    block: _Block,
    belief: Array,
    sides: tuple[Array, Array],
    transition: Transition,
    hypothesis: int,
    observed: Array,
    of_place: Array,
    of_speed: Vector,
) -> None:
    """Predict and update the beliefs of one hypothesis in a block.

    Args:
        block: which one.
        belief: (S, K) float32; receives those after the frame.
        sides: beliefs with changed speeds, (S, REACH) float32 each, in the places before the block,
            which receives those before the next one, and in those after all.
        transition: see ``advance``.
        hypothesis: 0 for the map, 1 for its reverse.
        observed: see ``advance``.
        of_place: (K,) float32, sums over the speeds; receives them.
        of_speed: (S,) float64, the sums over the places are added to it.
    """
    motion, size, moving = transition.motion, block.size, block.moving
    first, end = block.first, block.first + size
    ahead = min(end + REACH, belief.shape[1])
    inside = REACH + ahead - first  # where in ``moving`` all places end
    _sum_changes(belief[0, first:ahead], of_place[first:ahead], motion.change, block.changed)
    sums = block.predicted[:size], of_place[first:end]
    sums[0][:], sums[1][:] = 0, 0
    looks = observed[0, first:end], observed[1, first:end]
    before, after_all = sides
    for speed in range(len(of_speed)):
        kept, change = np.float32(transition.kept), motion.change[speed]
        stay, join = kept * (np.float32(1) - change), kept * transition.prior[speed]
        moving[:REACH] = before[speed]
        _mix(belief[speed, first:ahead], stay, block.changed, join, moving[REACH:inside])
        moving[inside : size + 2 * REACH] = after_all[speed, : size + 2 * REACH - inside]
        before[speed] = moving[size : size + REACH]
        chances, least = motion.chances[speed], motion.least[speed]
        way = 1 if hypothesis == 1 else -1
        sources = (
            moving[REACH + way * least :],
            moving[REACH + way * (least + 1) :],
            moving[REACH + way * (least + 2) :],
        )
        found, after = transition.found[hypothesis, speed], belief[speed, first:end]
        if least == 0:
            _stay_or_come(chances, sources, block.steps[speed], found, looks, after, sums)
        else:
            _come(chances[least:], sources, block.steps[speed], found, looks, after, sums)
        of_speed[speed] += _sum_of_block(after)


@kernel
def _mixed_halo(halo: Array, transition: Transition) -> Array:
    """Change the speeds of the beliefs outside as ``advance`` does those inside."""
    mixed = np.empty_like(halo)
    changed = np.empty(REACH, np.float32)
    change = transition.motion.change
    for hypothesis in range(len(halo)):
        of_place = halo[hypothesis].sum(axis=0)
        _sum_changes(halo[hypothesis, 0], of_place, change, changed)
        for speed in range(len(change)):
            stay, join = np.float32(1) - change[speed], transition.prior[speed]
            _mix(halo[hypothesis, speed], stay, changed, join, mixed[hypothesis, speed])
    return mixed


@kernel
def _sum_changes(standing: Array, of_place: Array, change: Array, changed: Array) -> None:
    """Sum over the speeds what leaves each of them: as much of all but the first, standing."""
    moves = change[-1]
    more = change[0] - moves
    for i in range(len(standing)):
        changed[i] = moves * of_place[i] + more * standing[i]


@kernel
def _mix(belief: Array, stay: float, changed: Array, join: float, mixed: Array) -> None:
    """Write the beliefs at one speed after changes of speed."""
    for i in range(len(mixed)):
        mixed[i] = stay * belief[i] + join * changed[i]


@kernel
def _stay_or_come(
    chances: Array,
    sources: tuple[Array, Array, Array],
    steps: Array,
    found: float,
    looks: tuple[Array, Array],
    after: Array,
    sums: tuple[Array, Array],
) -> None:
    """Predict and update the beliefs in n places at a speed whose steps are of 0 to 2 places.

    Args:
        chances: of steps of so many places, float32.
        sources: beliefs in the places themselves, in those a step of one away, and of two.
        steps: (n,) float32, likelihood of the step.
        found: probability of each place of a vehicle that was lost.
        looks: by how much likelier the frame is for one that stayed and for one that has come.
        after: (n,) float32, receives the beliefs.
        sums: (n,) float32 each; the beliefs before and after the update are added to them.
    """
    here, near, far = sources
    predicted, updated = sums
    again, anew = looks
    for i in range(len(after)):
        stayed = chances[0] * here[i] * steps[i]
        came = (chances[1] * near[i] + chances[2] * far[i]) * steps[i] + found
        predicted[i] += stayed + came
        after[i] = stayed * again[i] + came * anew[i]
        updated[i] += after[i]


@kernel
def _come(
    chances: Array,
    sources: tuple[Array, Array, Array],
    steps: Array,
    found: float,
    looks: tuple[Array, Array],
    after: Array,
    sums: tuple[Array, Array],
) -> None:
    """Do the same at a speed at which nobody stays: ``sources`` are three places on end."""
    near, middle, far = sources
    predicted, updated = sums
    anew = looks[1]
    for i in range(len(after)):
        moved = chances[0] * near[i] + chances[1] * middle[i] + chances[2] * far[i]
        came = moved * steps[i] + found
        predicted[i] += came
        after[i] = came * anew[i]
        updated[i] += after[i]


@kernel
def _multiply(values: Array, factors: Array) -> None:
    for i in range(len(values)):
        values[i] *= factors[i]


@kernel
def _sum_of_block(values: Array) -> float:
    """Sum a block's values: few enough for float32, side by side."""
    lanes = np.zeros(_LANES, np.float32)
    for start in range(0, len(values), _LANES):
        some = values[start : start + _LANES]
        for i in range(len(some)):
            lanes[i] += some[i]
    return sum_of(lanes)
