"""The filter's predict and update in one pass over its beliefs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.motion import REACH, SPEEDS, Array, Motion, step_likelihood

_BLOCK = 1024  # places whose beliefs stay in the cache from one loop to the next
_LANES = 64  # pairs of partial sums of a block that are added side by side
# Indices are unsigned. A signed one may count from the end, so loops over it are not vectorised.
_ONE, _TWO, _REACH, _HYPOTHESES = np.uint64(1), np.uint64(2), np.uint64(REACH), np.uint64(2)
_SPEEDS = SPEEDS  # a constant of compiled code

Vector = NDArray[np.float64]
Index = int | np.uint64
State = tuple[Index, Index]
"""A hypothesis and a speed."""


class Transition(NamedTuple):
    """The transition from one frame to the next.

    Attributes:
        motion: the motion model.
        prior: (S,) float32, chance of each speed after a change.
        kept: factor on all beliefs.
        found: (2, S) float32, probability that a lost vehicle is found at a place, for each speed,
            on the map and its reverse.
        step: length of the step, in descriptor space; ``UNKNOWN`` if it is not known.
        stationary: length of the step of a stationary vehicle.
    """

    motion: Motion
    prior: Array
    kept: float
    found: Array
    step: float
    stationary: float


class _Beliefs(NamedTuple):
    """The beliefs of a shard, and what updates them; see ``advance``.

    Attributes:
        belief: (2, S, K) float32.
        by_place: (2, K) float32.
        ratios: (2, K) float32.
    """

    belief: Array
    by_place: Array
    ratios: Array


class _Block(NamedTuple):
    """A block of places, and buffers for it.

    Attributes:
        first: its first place.
        size: how many places it has.
        within: how many there are up to the last one that a step from the block leads to.
        steps: (S, _BLOCK) float32, likelihood of the step by the place it leads to.
        changed: (_BLOCK + REACH,) float32, belief that changes its speed, in the block and after
            it.
        moving: (_BLOCK + 2 * REACH,) float32, beliefs at one speed, before, in and after the block.
        predicted: (_BLOCK,) float32, beliefs before the update, at all speeds.
    """

    first: Index
    size: Index
    within: Index
    steps: Array
    changed: Array
    moving: Array
    predicted: Array


@kernel
def advance(
    belief: Array,
    pieces: NDArray[np.int32],
    halos: Array,
    transition: Transition,
    apart: Array,
    ratios: Array,
    full_ratio: Array,
    by_place: Array,
    by_speed: Vector,
) -> tuple[float, float]:
    """Predict the beliefs in K places from those of the frame before, and update them.

    Args:
        belief: (2, S, K) float32, on the map and on its reverse, where the vehicle moves the other
            way; receives the beliefs after the frame.
        pieces: (P + 1,) int32, where each piece of the places begins, then K. Beliefs move from
            place to place in a piece, and into it from its halo only.
        halos: (P, 2, S, REACH) float32, beliefs, times ``kept``, in the places before each piece on
            the map, and in those after it on its reverse.
        transition: from the frame before to this one.
        apart: (6, K) float32, see ``StepLengths``.
        ratios: (2, K) float32, likelihood ratio of the frame at each place to that when lost, for a
            vehicle that was there already, and for one that has come there.
        full_ratio: (K,) float32, the same if all of the evidence counts.
        by_place: (2, K) float32, sums of the beliefs over the speeds; receives the new ones.
        by_speed: (2, S) float64, receives the sums over the places.

    Returns:
        The sum of the beliefs on the map before the update, and the sum of each times its
        ``full_ratio``.
    """
    beliefs, speeds = _Beliefs(belief, by_place, ratios), len(transition.prior)
    steps = np.empty((speeds, _BLOCK), np.float32)
    changed = np.empty(_BLOCK + REACH, np.float32)
    moving = np.empty(_BLOCK + 2 * REACH, np.float32)
    predicted = np.empty(_BLOCK, np.float32)
    total, of_likelihood = 0.0, 0.0
    by_speed[:] = 0
    for piece in range(len(halos)):
        end = pieces[piece + 1]
        # The places before a block are overwritten first, so their old beliefs are kept here.
        before = _mixed_halo(halos[piece], transition)
        sides = before, before[1].copy()
        for first in range(pieces[piece], end, _BLOCK):
            size, within = min(_BLOCK, end - first), min(_BLOCK + REACH, end - first)
            block = _Block(
                np.uint64(first),
                np.uint64(size),
                np.uint64(within),
                steps,
                changed,
                moving,
                predicted,
            )
            for speed in range(speeds):
                step_likelihood(
                    apart,
                    first,
                    transition.stationary,
                    _SPEEDS[speed],
                    transition.step,
                    steps[speed, :size],
                )
            for hypothesis in range(_HYPOTHESES):
                _advance_block(beliefs, block, hypothesis, sides, transition, by_speed)
                if hypothesis == 0:
                    total += _sum_of_block(predicted[:size])
                    _multiply(predicted[:size], full_ratio[first : first + size])
                    of_likelihood += _sum_of_block(predicted[:size])
    return total, of_likelihood


@kernel
def _advance_block(
    beliefs: _Beliefs,
    block: _Block,
    hypothesis: Index,
    sides: tuple[Array, Array],
    transition: Transition,
    by_speed: Vector,
) -> None:
    """Predict and update the beliefs of one hypothesis in a block.

    Args:
        beliefs: of all places.
        block: the block.
        hypothesis: 0 for the map, 1 for its reverse.
        sides: beliefs with changed speeds: in the places before the block, (2, S, REACH) float32,
            replaced by those before the next one; and in the places after its piece, (S, REACH).
        transition: see ``advance``.
        by_speed: (2, S) float64; receives, added, the sums over the places of the block.
    """
    motion, first, size, moving = transition.motion, block.first, block.size, block.moving
    before, after_all = sides
    _sum_changes(beliefs, block, hypothesis, motion.change)
    for i in range(size):
        block.predicted[i] = 0
        beliefs.by_place[hypothesis, first + i] = 0
    kept = np.float32(transition.kept)
    for speed in range(np.uint64(len(motion.change))):
        state = hypothesis, speed
        stay, join = kept * (np.float32(1) - motion.change[speed]), kept * transition.prior[speed]
        for i in range(_REACH):
            moving[i] = before[hypothesis, speed, i]
        _mix(beliefs, block, state, (stay, join))
        for i in range(size + _REACH - block.within):
            moving[_REACH + block.within + i] = after_all[speed, i]
        for i in range(_REACH):
            before[hypothesis, speed, i] = moving[size + i]
        least = np.uint64(motion.least[speed])
        steps = least, least + _ONE, least + _TWO
        chances = (
            motion.chances[speed, steps[0]],
            motion.chances[speed, steps[1]],
            motion.chances[speed, steps[2]],
        )
        if hypothesis == 0:
            sources = _REACH - steps[0], _REACH - steps[1], _REACH - steps[2]
        else:
            sources = _REACH + steps[0], _REACH + steps[1], _REACH + steps[2]
        found = transition.found[hypothesis, speed]
        if least == 0:
            _stay_or_come(beliefs, block, state, chances, sources, found)
        else:
            _come(beliefs, block, state, chances, sources, found)
        by_speed[hypothesis, speed] += _sum_of_block(
            beliefs.belief[hypothesis, speed, first : first + size]
        )


@kernel
def _sum_changes(beliefs: _Beliefs, block: _Block, h: Index, change: Array) -> None:
    """Sum the belief that leaves each speed: the same fraction of all but the first, stationary."""
    belief, by_place, _ = beliefs
    first, moves = block.first, change[_ONE]
    more = change[0] - moves
    for i in range(block.within):
        block.changed[i] = moves * by_place[h, first + i] + more * belief[h, 0, first + i]


@kernel
def _mix(beliefs: _Beliefs, block: _Block, state: State, factors: tuple[float, float]) -> None:
    """Write the beliefs at one speed, in the block and after it, after changes of speed."""
    (h, s), (stay, join) = state, factors
    belief, first, moving, changed = beliefs.belief, block.first, block.moving, block.changed
    for i in range(block.within):
        moving[_REACH + i] = stay * belief[h, s, first + i] + join * changed[i]


@kernel
def _stay_or_come(
    beliefs: _Beliefs,
    block: _Block,
    state: State,
    chances: tuple[float, float, float],
    sources: tuple[Index, Index, Index],
    found: float,
) -> None:
    """Predict and update the beliefs in a block at a speed whose steps are of 0 to 2 places.

    Args:
        beliefs: receive those after the frame.
        block: the block, with the beliefs that move.
        state: the hypothesis and the speed.
        chances: of the steps of each length, float32.
        sources: where in ``block.moving`` each of these steps leads from, to the first place.
        found: probability that a lost vehicle is found at a place, float32.
    """
    (h, s), (here, near, far) = state, sources
    belief, by_place, ratios = beliefs
    first, moving, steps, predicted = block.first, block.moving, block.steps, block.predicted
    for i in range(block.size):
        stayed = chances[0] * moving[here + i] * steps[s, i]
        came = (chances[1] * moving[near + i] + chances[2] * moving[far + i]) * steps[s, i] + found
        predicted[i] += stayed + came
        after = stayed * ratios[0, first + i] + came * ratios[1, first + i]
        belief[h, s, first + i] = after
        by_place[h, first + i] += after


@kernel
def _come(
    beliefs: _Beliefs,
    block: _Block,
    state: State,
    chances: tuple[float, float, float],
    sources: tuple[Index, Index, Index],
    found: float,
) -> None:
    """Predict and update as above, at a speed at which no vehicle stays at its place."""
    (h, s), (near, middle, far) = state, sources
    belief, by_place, ratios = beliefs
    first, moving, steps, predicted = block.first, block.moving, block.steps, block.predicted
    for i in range(block.size):
        nearer = chances[0] * moving[near + i] + chances[1] * moving[middle + i]
        came = (nearer + chances[2] * moving[far + i]) * steps[s, i] + found
        predicted[i] += came
        after = came * ratios[1, first + i]
        belief[h, s, first + i] = after
        by_place[h, first + i] += after


@kernel
def _mixed_halo(halo: Array, transition: Transition) -> Array:
    """Change the speeds of the beliefs in the halo, as ``advance`` does in the shard."""
    mixed, change = np.empty_like(halo), transition.motion.change
    moves = change[_ONE]
    more = change[0] - moves
    for h in range(len(halo)):
        by_place, changed = np.zeros(REACH, np.float32), np.empty(REACH, np.float32)
        for s in range(len(change)):
            for i in range(REACH):
                by_place[i] += halo[h, s, i]
        for i in range(REACH):
            changed[i] = moves * by_place[i] + more * halo[h, 0, i]
        for s in range(len(change)):
            stay, join = np.float32(1) - change[s], transition.prior[s]
            for i in range(REACH):
                mixed[h, s, i] = stay * halo[h, s, i] + join * changed[i]
    return mixed


@kernel
def _multiply(values: Array, factors: Array) -> None:
    for i in range(len(values)):
        values[i] *= factors[i]


@kernel
def _sum_of_block(values: Array) -> float:
    """Sum a block's values. They are few enough for sums in float32."""
    lanes = np.zeros(2 * _LANES, np.float32)
    for start in range(0, len(values), 2 * _LANES):
        some = values[start : start + 2 * _LANES]
        for i in range(len(some)):
            lanes[i] += some[i]
    total = 0.0
    for i in range(_LANES):
        total += np.float64(lanes[i]) + np.float64(lanes[i + _LANES])
    return total
