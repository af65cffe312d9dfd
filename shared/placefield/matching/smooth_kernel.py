"""The backward pass in one frame, on the places that were believed in."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.motion import FIND, HYPOTHESES, LOSE, REACH, Array, Motion

Vector = NDArray[np.float64]

_MAP_SHARE, _NULL_SHARE = float(HYPOTHESES[0]), float(HYPOTHESES[1])
_FIND, _LOSE = FIND, LOSE


@kernel
def step_back(
    places: NDArray[np.int32],
    ahead: Array,
    seen: Array,
    steps: Array,
    prior: Array,
    motion: Motion,
    lost: tuple[Vector, Vector, float],
    before: NDArray[np.int32],
    rows: NDArray[np.int32],
    backward: Array,
) -> Vector:
    """Take how likely what follows is from a frame back to the frame before it.

    Args:
        places: (n,) int32, that were believed in at the frame.
        ahead: (n, 2, S) float32, how likely what follows the frame is in each; is changed.
        seen: (2, n) float32, by how much likelier the frame is there than when lost, for a vehicle
            that was there already, and for one that has come there.
        steps: (S, n) float32, likelihood of the observed step, by the place that it leads to.
        prior: (S,) float32, of the speeds in the transition.
        motion: of the vehicle.
        lost: how likely what follows the frame is when lost, (S,) float64; likelihood of the step
            of a vehicle that stays lost, (S,) float64; likelihood of a jump.
        before: (m,) int32, places that were believed in at the frame before.
        rows: (K,) int32, -1 everywhere; is used, and -1 everywhere again.
        backward: (m, 2, S) float32, receives how likely what follows is from each of them.

    Returns:
        The same from being lost at the frame before, (S,). All are in a unit of their greatest.
    """
    when_lost, stray, jump = lost
    speeds, count = len(prior), len(rows)
    found = np.zeros(speeds)
    for i in range(len(places)):
        rows[places[i]] = i
        for speed in range(speeds):
            both = _MAP_SHARE * ahead[i, 0, speed] + _NULL_SHARE * ahead[i, 1, speed]
            found[speed] += both * seen[1, i]
            ahead[i, 0, speed] *= steps[speed, i]
            ahead[i, 1, speed] *= steps[speed, i]
    reached = np.empty(speeds, np.float32)
    adrift = stray * ((1 - _FIND) * when_lost + _FIND / count * found)
    from_lost = adrift + motion.change * ((motion.prior * adrift).sum() - adrift)
    to_lost = np.float32(_LOSE * jump * (motion.prior * when_lost).sum())
    top = from_lost.max()
    for j in range(len(before)):
        for hypothesis in range(2):
            reached[:] = 0
            for step in range(REACH + 1):
                place = before[j] + (step if hypothesis == 0 else -step)
                if 0 <= place < count and rows[place] >= 0:
                    i = rows[place]
                    there = seen[0 if step == 0 else 1, i]
                    for speed in range(speeds):
                        chance = motion.chances[speed, step] * there
                        reached[speed] += chance * ahead[i, hypothesis, speed]
            mixed = np.float32(0)
            for speed in range(speeds):
                mixed += prior[speed] * reached[speed]
            for speed in range(speeds):
                change = motion.change[speed]
                kept = reached[speed] + change * (mixed - reached[speed])
                value = np.float32(1 - _LOSE) * kept + to_lost
                backward[j, hypothesis, speed] = value
                top = max(top, value)
    for place in places:
        rows[place] = -1
    for j in range(len(before)):
        for hypothesis in range(2):
            for speed in range(speeds):
                backward[j, hypothesis, speed] = backward[j, hypothesis, speed] / np.float32(top)
    return np.asarray(from_lost / top)
