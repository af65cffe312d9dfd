"""The filter's predict and update in one pass over its beliefs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.motion import REACH, SPEEDS, Array, Motion, step_likelihood

_BLOCK = 1024  # places whose beliefs stay in the cache from one loop to the next
_LANES = 128  # partial sums of a block that are added side by side
_SPEEDS = SPEEDS  # a constant of compiled code

Vector = NDArray[np.float64]


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


class _Block(NamedTuple):
    """A block of places, and buffers for it.

    Attributes:
        first: its first place.
        size: how many places it has.
        end: where the places of its piece end.
        steps: (S, _BLOCK) float32, likelihood of the step by the place it leads to.
        changed: (_BLOCK + REACH,) float32, belief that changes its speed, in the block and after
            it.
        moving: (_BLOCK + 2 * REACH,) float32, beliefs at one speed, before, in and after the block.
        predicted: (_BLOCK,) float32, beliefs before the update, at all speeds.
    """

    first: int
    size: int
    end: int
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
    speeds = len(transition.prior)
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
        after_all = before[1].copy()
        for first in range(pieces[piece], end, _BLOCK):
            size = min(_BLOCK, end - first)
            block = _Block(first, size, end, steps, changed, moving, predicted)
            for speed in range(speeds):
                likelihoods, places_per_frame = steps[speed, :size], _SPEEDS[speed]
                step_likelihood(
                    apart,
                    first,
                    transition.stationary,
                    places_per_frame,
                    transition.step,
                    likelihoods,
                )
            for hypothesis in range(2):
                sides = before[hypothesis], after_all
                own, sums = belief[hypothesis], by_place[hypothesis]
                _advance_block(
                    block, own, sides, transition, hypothesis, ratios, sums, by_speed[hypothesis]
                )
                if hypothesis == 0:
                    total += _sum_of_block(predicted[:size])
                    _multiply(predicted[:size], full_ratio[first : first + size])
                    of_likelihood += _sum_of_block(predicted[:size])
    return total, of_likelihood


@kernel
def _advance_block(
    block: _Block,
    belief: Array,
    sides: tuple[Array, Array],
    transition: Transition,
    hypothesis: int,
    ratios: Array,
    by_place: Array,
    by_speed: Vector,
) -> None:
    """Predict and update the beliefs of one hypothesis in a block.

    Args:
        block: the block.
        belief: (S, K) float32; receives those after the frame.
        sides: beliefs with changed speeds, (S, REACH) float32 each: in the places before the block,
            replaced by those before the next one, and in the places after its piece.
        transition: see ``advance``.
        hypothesis: 0 for the map, 1 for its reverse.
        ratios: see ``advance``.
        by_place: (K,) float32, sums over the speeds; receives the new ones.
        by_speed: (S,) float64, receives, added, the sums over the places.
    """
    motion, size, moving = transition.motion, block.size, block.moving
    first, end = block.first, block.first + size
    limit = min(end + REACH, block.end)
    inside = REACH + limit - first  # where in ``moving`` the piece ends
    _sum_changes(belief[0, first:limit], by_place[first:limit], motion.change, block.changed)
    sums = block.predicted[:size], by_place[first:end]
    sums[0][:], sums[1][:] = 0, 0
    own_ratios = ratios[0, first:end], ratios[1, first:end]
    before, after_all = sides
    for speed in range(len(by_speed)):
        kept, change = np.float32(transition.kept), motion.change[speed]
        stay, join = kept * (np.float32(1) - change), kept * transition.prior[speed]
        moving[:REACH] = before[speed]
        _mix(belief[speed, first:limit], stay, block.changed, join, moving[REACH:inside])
        moving[inside : size + 2 * REACH] = after_all[speed, : size + 2 * REACH - inside]
        before[speed] = moving[size : size + REACH]
        chances, least = motion.chances[speed], motion.least[speed]
        direction = 1 if hypothesis == 1 else -1
        sources = (
            moving[REACH + direction * least :],
            moving[REACH + direction * (least + 1) :],
            moving[REACH + direction * (least + 2) :],
        )
        found, after = transition.found[hypothesis, speed], belief[speed, first:end]
        if least == 0:
            _stay_or_come(chances, sources, block.steps[speed], found, own_ratios, after, sums)
        else:
            _come(chances[least:], sources, block.steps[speed], found, own_ratios, after, sums)
        by_speed[speed] += _sum_of_block(after)


@kernel
def _mixed_halo(halo: Array, transition: Transition) -> Array:
    """Change the speeds of the beliefs in the halo, as ``advance`` does in the shard."""
    mixed = np.empty_like(halo)
    changed = np.empty(REACH, np.float32)
    change = transition.motion.change
    for hypothesis in range(len(halo)):
        by_place = halo[hypothesis].sum(axis=0)
        _sum_changes(halo[hypothesis, 0], by_place, change, changed)
        for speed in range(len(change)):
            stay, join = np.float32(1) - change[speed], transition.prior[speed]
            _mix(halo[hypothesis, speed], stay, changed, join, mixed[hypothesis, speed])
    return mixed


@kernel
def _sum_changes(stationary: Array, by_place: Array, change: Array, changed: Array) -> None:
    """Sum the belief that leaves each speed: the same fraction of all but the first, stationary."""
    moves = change[-1]
    more = change[0] - moves
    for i in range(len(stationary)):
        changed[i] = moves * by_place[i] + more * stationary[i]


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
    ratios: tuple[Array, Array],
    after: Array,
    sums: tuple[Array, Array],
) -> None:
    """Predict and update the beliefs in n places at a speed whose steps are of 0 to 2 places.

    Args:
        chances: of steps of so many places, float32.
        sources: beliefs in the places themselves, in those one place away, and two places away.
        steps: (n,) float32, likelihood of the step.
        found: probability that a lost vehicle is found at a place.
        ratios: likelihood ratios of the frame for a vehicle that stayed, and for one that has come.
        after: (n,) float32, receives the beliefs.
        sums: (n,) float32 each; receive, added, the beliefs before and after the update.
    """
    here, near, far = sources
    predicted, updated = sums
    again, anew = ratios
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
    ratios: tuple[Array, Array],
    after: Array,
    sums: tuple[Array, Array],
) -> None:
    """Predict and update as above, where no vehicle stays. ``sources`` are successive places."""
    near, middle, far = sources
    predicted, updated = sums
    anew = ratios[1]
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
    """Sum a block's values. They are few enough for sums in float32."""
    lanes = np.zeros(_LANES, np.float32)
    for start in range(0, len(values), _LANES):
        some = values[start : start + _LANES]
        for i in range(len(some)):
            lanes[i] += some[i]
    return sum_of(lanes)
