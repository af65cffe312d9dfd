"""The filter's frame in one pass over its beliefs: change speed, move, be lost or found, see."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of

Array = NDArray[np.float32]

_BLOCK = 2048  # places whose beliefs stay in the cache from one loop to the next
REACH = 2
"""Places that a step takes at most."""


class Motion(NamedTuple):
    """How the vehicle moves at S speeds, by steps of 0, 1 or 2 places, in a map of K.

    Attributes:
        change: (S,) float32, chance that the speed changes from one frame to the next.
        prior: (S,) float32, chance of each speed after a change.
        chances: (S, 3) float32, of each step.
        anywhere: (2, S) float32, chance of each place and speed, in map and decoy, of a vehicle
            that has just been found.
        lose: chance that a vehicle that is on the map is lost at the next frame.
        find: chance that one that is lost is on the map at the next frame.
    """

    change: Array
    prior: Array
    chances: Array
    anywhere: Array
    lose: float
    find: float


class Steps(NamedTuple):
    """How long steps are on the map; squared lengths of descriptors differ by 2 at most.

    Attributes:
        arriving: (2, K) float32, of steps of 1 and 2 places, by where they lead; of a shard,
            (2, K + 2), that of those to the places after it, too.
        some: (2, J) float32, some of them, that stand for all.
        jumps: (J,) float32, of jumps.
        standing: of no step.
        deviation: between the lengths of a step in two traverses.
    """

    arriving: Array
    some: Array
    jumps: Array
    standing: float
    deviation: float


@kernel
def step_length(codes: NDArray[np.int16], last: NDArray[np.int16], unit: float) -> float:
    """How far apart two vectors of codes are."""
    squares = np.int32(0)
    for m in range(len(codes)):
        difference = np.int32(np.int32(codes[m]) - np.int32(last[m]))
        squares = np.int32(squares + np.int32(difference * difference))
    return unit * math.sqrt(squares)


@kernel
def exponents_of(distances: NDArray[np.int32], scale: float, exponents: Array) -> int:
    """Write by how much each place is further than the nearest, (K,), times minus the scale.

    Return how far that is.
    """
    nearest = distances[0]
    for place in range(len(distances)):
        nearest = min(nearest, distances[place])
    for place in range(len(distances)):
        exponents[place] = np.float32(scale) * np.float32(np.int32(nearest - distances[place]))
    return int(nearest)


@kernel
def advance(
    belief: Array,
    unit: float,
    outside: Array,
    lost: float,
    total: float,
    motion: Motion,
    steps: Steps,
    step: float,
    likelihood: Array,
    of_place: Array,
) -> tuple[float, float]:
    """Move the beliefs on by a frame, and weigh those in places by what that frame shows.

    Args:
        belief: (2, S, K) float32, in the map and in the decoy, which is driven the other way;
            receives the beliefs after the frame.
        unit: of these.
        outside: (2, S, 2) float32, probabilities where steps into these places may begin outside
            them: of the two places before them in the map, and of the two after them in the decoy.
        lost: belief that the vehicle is lost.
        total: sum of all beliefs, inside, outside and lost.
        motion: of the vehicle.
        steps: of the map.
        step: how long the vehicle's was; negative where it was not seen.
        likelihood: (K,) float32, of what was seen of the place.
        of_place: (K,) float32, receives their sum over the speeds in the map.

    Returns:
        The sum of the beliefs in these places, and the probability that the vehicle is lost after
        the frame, before it is weighed by what that shows.
    """
    standing, jumping = np.float32(1), 1.0
    arriving = np.ones_like(steps.arriving)
    typical = np.ones(1 + REACH)
    if step >= 0:
        walked = np.float32(max(step, steps.standing))
        _students(steps.arriving, walked, steps.deviation, arriving)
        jumping = _mean_student(steps.jumps, np.float32(step), steps.deviation)
        standing = _student(walked - np.float32(steps.standing), steps.deviation)
        typical[0] = standing
        for row in range(REACH):
            typical[1 + row] = _mean_student(steps.some[row], walked, steps.deviation)
    was_lost = lost / total
    stray = 0.0
    for speed in range(len(motion.prior)):
        for row in range(1 + REACH):
            stray += motion.prior[speed] * motion.chances[speed, row] * typical[row]
    stray *= was_lost
    moved = _move(
        belief,
        np.float32((1 - motion.lose) * unit / total),
        _mixed(outside, np.float32(1 - motion.lose), motion),
        motion,
        standing,
        arriving,
        np.float32(motion.find * stray),
        likelihood,
        of_place,
    )
    return moved, (1 - motion.find) * stray + motion.lose * jumping * (1 - was_lost)


@kernel
def _mixed(outside: Array, kept: np.float32, motion: Motion) -> Array:
    """Change the speeds of the beliefs outside as ``_move`` does those inside."""
    mixed = np.empty_like(outside)
    changed = np.empty(REACH, np.float32)
    for sheet in range(len(outside)):
        _gather_changes(outside[sheet], motion.change, 0, changed)
        for speed in range(len(motion.change)):
            stay = kept * (np.float32(1) - motion.change[speed])
            join = kept * motion.prior[speed]
            _mix(outside[sheet, speed], stay, changed, join, changed, mixed[sheet, speed])
    return mixed


@kernel
def _move(
    belief: Array,
    kept: np.float32,
    outside: Array,
    motion: Motion,
    standing: np.float32,
    arriving: Array,
    found: np.float32,
    likelihood: Array,
    of_place: Array,
) -> float:
    """Do what ``advance`` says with the beliefs on the map; return their sum."""
    speeds, places = belief.shape[1:]
    # Buffers begin REACH places before the block and end as many after it. What lies before it has
    # been overwritten by then, and is kept.
    changed = np.empty(_BLOCK + REACH, np.float32)
    moving = np.empty(_BLOCK + 2 * REACH, np.float32)
    before = outside.copy()  # of the decoy, of which nothing moves on from there, no matter what
    by_one, by_two = np.empty(_BLOCK, np.float32), np.empty(_BLOCK, np.float32)
    sums = np.zeros(_BLOCK, np.float32)
    total = 0.0
    for start in range(0, places, _BLOCK):
        size = min(_BLOCK, places - start)
        seen = likelihood[start : start + size]
        for sheet in range(2):
            forward = sheet == 0
            _copy(arriving[0], start if forward else start + 1, by_one[:size])
            _copy(arriving[1], start if forward else start + 2, by_two[:size])
            _gather_changes(belief[sheet], motion.change, start, changed[: size + REACH])
            one_before = moving[1:] if forward else moving[3:]
            two_before = moving if forward else moving[4:]
            sums[:size] = 0
            for speed in range(speeds):
                stay = kept * (np.float32(1) - motion.change[speed])
                join = kept * motion.prior[speed]
                after = belief[sheet, speed, start : start + size]
                moving[:REACH] = before[sheet, speed]
                ahead = moving[REACH : size + 2 * REACH]
                _mix(belief[sheet, speed, start:], stay, changed, join, outside[1, speed], ahead)
                before[sheet, speed] = moving[size : size + REACH]
                gain = found * motion.anywhere[sheet, speed]
                stands = motion.chances[speed, 0] * standing
                one, two = motion.chances[speed, 1], motion.chances[speed, 2]
                for i in range(size):
                    arrived = stands * moving[REACH + i]
                    arrived += one * by_one[i] * one_before[i]
                    arrived += two * by_two[i] * two_before[i]
                    after[i] = (arrived + gain) * seen[i]
                _add(np.float32(1), after, sums[:size])
            total += sum_of(sums[:size])
            if forward:
                _copy(sums, 0, of_place[start : start + size])
    return total


@kernel
def _copy(values: Array, start: int, buffer: Array) -> None:
    """Copy what lies from ``start`` on; 0 where nothing does."""
    inside = max(min(len(buffer), len(values) - start), 0)
    for i in range(inside):
        buffer[i] = values[start + i]
    buffer[inside:] = 0


@kernel
def _gather_changes(belief: Array, change: Array, start: int, changed: Array) -> None:
    """Sum over the speeds what leaves each of them."""
    inside = min(len(changed), belief.shape[1] - start)
    changed[:] = 0
    for speed in range(len(change)):
        _add(change[speed], belief[speed, start : start + inside], changed[:inside])


@kernel
def _add(factor: np.float32, values: Array, sums: Array) -> None:
    for i in range(len(values)):
        sums[i] += factor * values[i]


@kernel
def _mix(
    belief: Array, stay: np.float32, changed: Array, join: np.float32, beyond: Array, moving: Array
) -> None:
    """Belief at a speed, after changes from it and to it, and what lies beyond the last place."""
    inside = min(len(moving), len(belief))
    for i in range(inside):
        moving[i] = stay * belief[i] + join * changed[i]
    moving[inside:] = beyond[: len(moving) - inside]


@kernel
def _students(lengths: Array, step: np.float32, deviation: float, likelihoods: Array) -> None:
    for row in range(len(lengths)):
        for i in range(lengths.shape[1]):
            likelihoods[row, i] = _student(step - lengths[row, i], deviation)


@kernel
def _mean_student(lengths: Array, step: np.float32, deviation: float) -> float:
    likelihoods = np.empty_like(lengths)
    for i in range(len(lengths)):
        likelihoods[i] = _student(step - lengths[i], deviation)
    return sum_of(likelihoods) / len(lengths)


@kernel
def _student(difference: np.float32, deviation: float) -> np.float32:
    """Density of Student's t with 2 degrees of freedom, up to a factor: it forgives outliers."""
    scaled = difference * np.float32(1 / deviation)
    spread = np.float32(1) + scaled * scaled * np.float32(0.5)
    density: np.float32 = np.float32(1) / (spread * np.sqrt(spread))
    return density


@kernel
def believed(
    of_place: Array, scale: float, least: float, places: NDArray[np.int32], beliefs: Array
) -> tuple[int, int]:
    """Pick the places of at least some belief, and the one of most.

    Args:
        of_place: (K,), the belief in each, to be multiplied by ``scale``.
        scale: see there.
        least: belief.
        places: (K,) int32, receives the places.
        beliefs: (K,) float32, receives the belief in them.

    Returns:
        How many there are, and which of them is the one of most belief.
    """
    best = 0
    for place in range(len(of_place)):
        if of_place[place] > of_place[best]:
            best = place
    threshold = min(np.float32(least / scale), of_place[best])
    count, best_of_them = 0, 0
    for place in range(len(of_place)):
        if of_place[place] >= threshold:
            if place == best:
                best_of_them = count
            places[count] = place
            beliefs[count] = of_place[place] * np.float32(scale)
            count += 1
    return count, best_of_them
