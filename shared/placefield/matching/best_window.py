"""The window of places that has most of a posterior."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.maps.topology import Topology
from placefield.matching.chains import ONE_CHAIN, Chains, chains_of

Places = NDArray[np.int32]
Beliefs = NDArray[np.float32]
Rows = NDArray[np.intp]
Positions = NDArray[np.int64]


def twins_in(same: Places) -> Places | None:
    """Return which place each is the same as, (K,); None if all places differ."""
    return None if np.array_equal(same, np.arange(len(same))) else same


class Vicinity(NamedTuple):
    """What is near a place of a map.

    Two places are near each other if they, or the places that they are the same as, are within the
    tolerance: so many steps of a vehicle lead from one to the other at most.

    Attributes:
        tolerance: steps.
        same: (K,) int32, which place of the map each is the same as; None: all differ.
        chains: of the map, with passages of twice the tolerance.
    """

    tolerance: int
    same: Places | None = None
    chains: Chains = ONE_CHAIN


def vicinity_of(topology: Topology, tolerance: int) -> Vicinity:
    """Return what is near a place of a map."""
    count = topology.count
    chains = chains_of(topology.graph, count, min(2 * tolerance, count))
    return Vicinity(tolerance, twins_in(topology.same), chains)


def best_window(places: Places, beliefs: Beliefs, vicinity: Vicinity) -> tuple[int, float]:
    """Return the middle of the window of highest belief, and the belief near the middle.

    A window is 2 tolerance + 1 consecutive places on a way of the vehicle. Laps of one stretch
    share their belief; the middle is in the lap of highest belief.

    Args:
        places: (n,) int32, ascending; may contain duplicates.
        beliefs: (n,) float32; clipped to 0 to 1, because they may come from the bus.
        vicinity: of the places of the map.
    """
    tolerance, same, chains = vicinity
    if same is not None:
        return _best_of_laps(places, beliefs, same, chains, tolerance)
    if chains.is_one:
        return _best_on_a_line(places, beliefs, tolerance)
    return _best_on_ways(places, beliefs, chains, tolerance)


@kernel
def _best_of_laps(
    places: Places, beliefs: Beliefs, same: Places, chains: Chains, tolerance: int
) -> tuple[int, float]:
    """Do as ``best_window`` does where some places are the same."""
    shared = same[places]
    order = np.argsort(shared.astype(np.int64), kind="mergesort")
    rows, _ = _best(shared[order], beliefs[order], chains, tolerance)
    laps = np.zeros(len(places), np.bool_)
    for row in rows:
        laps[order[row]] = True
    middle = _middle_of_best(places[laps], beliefs[laps], chains, tolerance)
    near = np.zeros(len(places), np.bool_)
    _mark_near(near, middle, places, chains, tolerance)
    other = int(np.intp(same[middle]))  # of the same type, so that the next line needs no compiling
    _mark_near(near, other, shared, chains, tolerance)
    return middle, _sum_of(beliefs, near)


@kernel
def _best_on_ways(
    places: Places, beliefs: Beliefs, chains: Chains, tolerance: int
) -> tuple[int, float]:
    """Do as ``best_window`` does where all places differ."""
    middle = _middle_of_best(places, beliefs, chains, tolerance)
    near = np.zeros(len(places), np.bool_)
    _mark_near(near, middle, places, chains, tolerance)
    return middle, _sum_of(beliefs, near)


@kernel
def _middle_of_best(places: Places, beliefs: Beliefs, chains: Chains, tolerance: int) -> int:
    """Return the middle of the window of highest belief, where all places differ."""
    rows, at = _best(places, beliefs, chains, tolerance)
    middle, chain = _middle(at, beliefs[rows]), len(chains.edges) - 2
    while chain > 0 and middle < _position(chains.edges[chain], chain, tolerance) - 2 * tolerance:
        chain -= 1
    begin = _position(chains.edges[chain], chain, tolerance)
    if middle >= begin:
        return int(chains.edges[chain] + middle - begin)
    nearest = 0  # the middle is before the chain, on one of the ways to it
    for i in range(1, len(at)):
        farther = abs(at[i] - middle) - abs(at[nearest] - middle)
        if farther < 0 or (farther == 0 and beliefs[rows[i]] > beliefs[rows[nearest]]):
            nearest = i
    return int(places[rows[nearest]])


@kernel
def _best(
    places: Places, beliefs: Beliefs, chains: Chains, tolerance: int
) -> tuple[Rows, Positions]:
    """Return the rows of the places in the window of highest belief, and their positions."""
    rows, at = _unfold(places, chains, tolerance)
    first, end = _window(at, beliefs[rows], tolerance)
    return rows[first:end], at[first:end]


@kernel
def _position(place: int, chain: int, tolerance: int) -> int:
    """Return the position of a place: as in the map, but no window reaches two chains."""
    return place + (4 * tolerance + 1) * chain


@kernel
def _chain_of(place: int, chains: Chains) -> int:
    """Return the number of the chain of a place."""
    return _count_up_to(place, chains.edges[1:-1])


@kernel
def _count_up_to(most: int, ascending: Places) -> int:
    """Return how many of some ascending places are at most so great."""
    first, end = 0, len(ascending)
    while first < end:
        middle = (first + end) // 2
        if ascending[middle] <= most:
            first = middle + 1
        else:
            end = middle
    return first


@kernel
def _unfold(places: Places, chains: Chains, tolerance: int) -> tuple[Rows, Positions]:
    """Return positions of places, ascending, and their rows among the places.

    A place from which a passage leads to a chain has a position before that chain, too.
    """
    edges, ahead = chains.edges, chains.ahead
    rows = list(range(len(places)))
    at = [_position(place, _chain_of(place, chains), tolerance) for place in places]
    for i in range(len(ahead.source)):
        source, target, shift = ahead.source[i], ahead.target[i], int(ahead.shift[i])
        first = max(edges[source], edges[target] + shift - 2 * tolerance)
        end = _count_up_to(edges[source + 1] - 1, places)
        for row in range(_count_up_to(first - 1, places), end):
            rows.append(row)
            at.append(_position(places[row] - shift, target, tolerance))
    positions = np.array(at)
    order = np.argsort(positions, kind="mergesort")
    return np.array(rows)[order], positions[order]


@kernel
def _mark_near(
    near: NDArray[np.bool_], middle: int, places: Places, chains: Chains, tolerance: int
) -> None:
    """Mark the places, (n,), that are near a place by their steps."""
    own, ahead = _chain_of(middle, chains), chains.ahead
    of = np.empty(len(places), np.intp)
    for row in range(len(places)):
        of[row] = _chain_of(places[row], chains)
        near[row] |= of[row] == own and abs(places[row] - middle) <= tolerance
    for i in range(len(ahead.source)):
        source, target, shift = ahead.source[i], ahead.target[i], int(ahead.shift[i])
        if own not in (source, target):
            continue
        for row in range(len(places)):
            farther = places[row] - middle
            near[row] |= source == own and target == of[row] and farther + shift <= tolerance
            near[row] |= source == of[row] and target == own and shift - farther <= tolerance


@kernel
def _window(at: Positions, beliefs: Beliefs, tolerance: int) -> tuple[int, int]:
    """Return where the 2 tolerance + 1 consecutive positions of highest belief begin and end."""
    best_first, best_end, best, end, within = 0, 0, -1.0, 0, 0.0
    for first in range(len(at)):
        while end < len(at) and at[end] <= at[first] + 2 * tolerance:
            within += min(max(beliefs[end], 0), 1)
            end += 1
        if within > best:
            best_first, best_end, best = first, end, within
        within -= min(max(beliefs[first], 0), 1)
    return best_first, best_end


@kernel
def _middle(at: Positions, beliefs: Beliefs) -> int:
    """Return the mean of positions, weighted by belief."""
    moment, weight = 0.0, 0.0
    for i in range(len(at)):
        belief = min(max(beliefs[i], 0), 1)
        moment += belief * at[i]
        weight += belief
    return round(moment / weight) if weight > 0 else int(at[0])


@kernel
def _best_on_a_line(places: Places, beliefs: Beliefs, tolerance: int) -> tuple[int, float]:
    """Do as ``best_window`` does where all places differ and are one chain."""
    at = places.astype(np.int64)
    first, end = _window(at, beliefs, tolerance)
    middle = _middle(at[first:end], beliefs[first:end])
    return middle, _sum_of(beliefs, np.abs(at - middle) <= tolerance)


@kernel
def _sum_of(beliefs: Beliefs, some: NDArray[np.bool_]) -> float:
    """Sum some of the beliefs."""
    total = 0.0
    for i in range(len(beliefs)):
        if some[i]:
            total += min(max(beliefs[i], 0), 1)
    return total
