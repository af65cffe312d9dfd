"""The backward pass over one frame, at the places of its trace."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.belief_kernels import pick
from placefield.matching.chains import Passages
from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    REACH,
    RESOLVED,
    SPEEDS,
    Array,
    motion,
    step_likelihoods,
)
from placefield.matching.trace import NEGLIGIBLE, ObservedTransition

Vector = NDArray[np.float64]
Places = NDArray[np.int32]

_FIND, _LOSE, _HYPOTHESES, _SPEEDS, _RESOLVED = FIND, LOSE, HYPOTHESES, SPEEDS, RESOLVED
_MOTION, _NEGLIGIBLE = motion(), NEGLIGIBLE
_BOTH, _STAY, _COME = np.uint64(2), np.uint64(0), np.uint64(1)  # unsigned, see ``filter_kernels``


@kernel
def step_back(
    transit: ObservedTransition,
    placed: Array,
    lost: Vector,
    apart: Array,
    stationary: float,
    edges: Places,
    passages: tuple[Passages, Passages] | None,
    before: Places,
) -> tuple[Array, Vector]:
    """Move the backward message from a frame back to the frame before it.

    The backward message is the likelihood of all later frames given the state at a frame.

    Args:
        transit: the transition to the frame.
        placed: (n, 2, S) float32, the message of the frame at each place.
        lost: (S,) float64, the same when lost.
        apart: (6, K) float32, see ``StepLengths``.
        stationary: see ``StepLengths``.
        edges: of the chains of the map, see ``Chains``.
        passages: of the chains, ahead and behind; None: there are none.
        before: (m,) int32, places in the trace of the frame before.

    Returns:
        The message of the frame before at each of them, (m, 2, S) float32, and when lost, (S,). It
        is scaled so that its greatest value is 1.
    """
    to_lost = _LOSE * transit.jump * (_MOTION.prior * lost).sum()
    weighted, found = _weighted(transit, placed, apart, stationary)
    still_lost = transit.lost_likelihood * ((1 - _FIND) * lost + _FIND / transit.all_places * found)
    from_lost = still_lost + _MOTION.change * ((_MOTION.prior * still_lost).sum() - still_lost)
    backward = _reach_back(transit, weighted, edges, passages, to_lost, before)
    values = backward.reshape(backward.size)
    top = from_lost.max()
    for i in range(len(values)):
        top = max(top, values[i])
    unit = np.float32(1 / top)
    for i in range(len(values)):
        values[i] *= unit
    return backward, from_lost / top


@kernel
def _weighted(
    transit: ObservedTransition, placed: Array, apart: Array, stationary: float
) -> tuple[Array, Vector]:
    """Weight the backward message by the frame and by the step to it.

    Returns:
        (2, 2, S, n + 1) float32, for a vehicle that stayed at each place and one that has come
        there, on the map and on its reverse, where the last entry is no place; and the sum over the
        places for a vehicle that was lost, (S,) float64.
    """
    places, observed = transit.places, transit.observed
    speeds, count = placed.shape[2], len(places)
    near = np.empty((len(apart), count), np.float32)
    for row in range(len(apart)):
        for i in range(count):
            near[row, i] = apart[row, places[i]]
    steps = np.empty((speeds, count), np.float32)
    step_likelihoods(near, stationary, _SPEEDS, transit.step, steps)
    weighted = np.empty((2, 2, speeds, count + 1), np.float32)
    found = np.zeros(speeds)
    for s in range(np.uint64(speeds)):
        for h in range(_BOTH):
            total = 0.0
            for i in range(np.uint64(count)):
                follows = placed[i, h, s]
                total += follows * observed[_COME, i]
                weighted[_STAY, h, s, i] = follows * steps[s, i] * observed[_STAY, i]
                weighted[_COME, h, s, i] = follows * steps[s, i] * observed[_COME, i]
            weighted[_STAY, h, s, count], weighted[_COME, h, s, count] = 0, 0
            found[s] += _HYPOTHESES[h] * total
    return weighted, found


@kernel
def _reach_back(
    transit: ObservedTransition,
    weighted: Array,
    edges: Places,
    passages: tuple[Passages, Passages] | None,
    to_lost: float,
    before: Places,
) -> Array:
    """Sum over the places that a vehicle may move to from each place, and over being lost.

    Args:
        transit: see ``step_back``.
        weighted: see ``_weighted``.
        edges: see ``step_back``.
        passages: see ``step_back``.
        to_lost: the message when lost, times the chance of that.
        before: see ``step_back``.

    Returns:
        The message, not scaled, (m, 2, S) float32.
    """
    speeds, kept, lost = len(_MOTION.prior), np.float32(1 - _LOSE), np.float32(to_lost)
    count = np.uint64(len(before))
    rows = np.empty((REACH + 1, len(before)), np.uint32)
    reached = np.empty((speeds, len(before)), np.float32)
    mixed = np.empty(len(before), np.float32)
    backward = np.empty((len(before), 2, speeds), np.float32)
    for h in range(_BOTH):
        _rows_in_reach(transit.places, before, edges, h, rows)
        crossings = None
        if passages is not None:
            crossings = _crossings(transit.places, before, edges, passages[h])
        mixed[:] = 0
        for s in range(np.uint64(speeds)):
            least = np.uint64(_MOTION.least[s])
            for j in range(count):
                reached[s, j] = 0
            for step in range(least, min(least + np.uint64(3), np.uint64(REACH + 1))):
                chance, part = _MOTION.chances[s, step], _STAY if step == 0 else _COME
                if chance > 0:
                    for j in range(count):
                        reached[s, j] += chance * weighted[part, h, s, rows[step, j]]
            if crossings is not None:
                _add_crossings(_MOTION.chances[s], weighted[_COME, h, s], crossings, reached[s])
            prior = transit.prior[s]
            for j in range(count):
                mixed[j] += prior * reached[s, j]
        for s in range(np.uint64(speeds)):
            change = _MOTION.change[s]
            for j in range(count):
                value = reached[s, j] + change * (mixed[j] - reached[s, j])
                backward[j, h, s] = kept * value + lost
    return backward


@kernel
def _crossings(
    places: Places, before: Places, edges: Places, passages: Passages
) -> tuple[NDArray[np.int32], Array]:
    """Return the steps over passages from some places, (m,), to others, (n,), all ascending.

    Returns:
        (c, 3) int32, the places in a step, and the numbers of both places in their arrays; and the
        chance of each passage, (c,) float32.
    """
    steps, chances = np.empty((0, 3), np.int32), np.empty(0, np.float32)
    for once in range(2):  # to count them, then to write them
        count = 0
        for passage in range(len(passages.source)):
            source, target = passages.source[passage], passages.target[passage]
            shift = int(passages.shift[passage])
            begin, end = edges[target], edges[target + 1]
            first = np.searchsorted(before, max(edges[source], begin + shift - REACH))
            last = np.searchsorted(before, min(edges[source + 1], end + shift + REACH))
            for j in range(first, last):
                i = np.searchsorted(places, max(begin, before[j] - shift - REACH))
                while i < len(places) and places[i] < end:
                    away = abs(places[i] + shift - before[j])
                    if away > REACH:
                        break
                    if once == 1:
                        steps[count, 0], steps[count, 1], steps[count, 2] = away, j, i
                        chances[count] = passages.chance[passage]
                    count += 1
                    i += 1
        if once == 0:
            steps, chances = np.empty((count, 3), np.int32), np.empty(count, np.float32)
    return steps, chances


@kernel
def _add_crossings(
    chances: Array, there: Array, crossings: tuple[NDArray[np.int32], Array], reached: Array
) -> None:
    """Add the message at the places that steps over passages lead to, at one speed."""
    steps, passage = crossings
    for crossing in range(len(steps)):
        places, j, i = steps[crossing]
        reached[j] += chances[places] * passage[crossing] * there[i]


@kernel
def _rows_in_reach(
    places: Places, before: Places, edges: Places, hypothesis: int, rows: NDArray[np.uint32]
) -> None:
    """Write which of n places a step of 0, 1, … in its chain leads to from other places, (m,).

    ``rows`` is (REACH + 1, m) uint32. It is n where a step leads to none of the n places.
    """
    rows[:] = len(places)
    first, chain = 0, 0  # the first place in reach of a place, and the chain of that; all ascend
    for j in range(len(before)):
        while edges[chain + 1] <= before[j]:
            chain += 1
        while first < len(places) and places[first] < before[j] - REACH:
            first += 1
        for i in range(first, len(places)):
            away = places[i] - before[j]
            if away > REACH:
                break
            step = away if hypothesis == 0 else -away
            in_chain = edges[chain] <= places[i] < edges[chain + 1]
            if (
                in_chain and 0 <= step <= REACH
            ):  # whatever came from other shards, who may not ascend
                rows[step, j] = i


@kernel
def weigh(
    places: Places, filtered: Array, message: Array, filtered_lost: Vector, message_lost: Vector
) -> tuple[Places, Array, float]:
    """Weight the filter's posterior of a frame by the backward message.

    Args:
        places: (n,) int32, ascending.
        filtered: (n, 2, S) float32, posterior on the map and on its reverse.
        message: (n, 2, S) float32, the backward message.
        filtered_lost: (S,) float64, posterior of being lost.
        message_lost: (S,) float64, the backward message when lost.

    Returns:
        See ``Posterior``.
    """
    belief = np.empty(len(filtered), np.float32)
    total = (filtered_lost * message_lost).sum()
    too_fast = (filtered_lost[_RESOLVED:] * message_lost[_RESOLVED:]).sum()
    for i in range(len(filtered)):
        on_map, on_null, faster = np.float32(0), np.float32(0), np.float32(0)
        for speed in range(_RESOLVED):
            on_map += filtered[i, 0, speed] * message[i, 0, speed]
            on_null += filtered[i, 1, speed] * message[i, 1, speed]
        for speed in range(_RESOLVED, filtered.shape[2]):
            for hypothesis in range(2):
                faster += filtered[i, hypothesis, speed] * message[i, hypothesis, speed]
        belief[i] = on_map
        total += on_map + on_null + faster
        too_fast += faster
    for i in range(len(belief)):
        belief[i] = np.float32(belief[i] / total)
    kept = pick(belief, min(_NEGLIGIBLE, float(belief.max())))
    return places[kept], belief[kept], float(min(too_fast / total, 1.0))
