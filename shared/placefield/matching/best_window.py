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
    same = vicinity.same
    if same is None and vicinity.chains.is_one:
        return _best_on_a_line(places, beliefs, vicinity.tolerance)
    if same is None:
        middle = _middle_of_best(places, beliefs, vicinity)
        return middle, _sum_of(beliefs, _near(middle, places, vicinity))
    shared = same[places]
    order = np.argsort(shared, kind="stable")
    rows, _ = _best(shared[order], beliefs[order], vicinity)
    laps = np.unique(order[rows])
    middle = _middle_of_best(places[laps], beliefs[laps], vicinity)
    near = _near(middle, places, vicinity) | _near(int(same[middle]), shared, vicinity)
    return middle, _sum_of(beliefs, near)


def _middle_of_best(places: Places, beliefs: Beliefs, vicinity: Vicinity) -> int:
    """Return the middle of the window of highest belief, where all places differ."""
    rows, at = _best(places, beliefs, vicinity)
    middle = _middle(at, beliefs[rows])
    edges = vicinity.chains.edges
    begins = _apart(edges[:-1], vicinity)
    chain = int(np.searchsorted(begins - 2 * vicinity.tolerance, middle, side="right")) - 1
    if middle >= begins[chain]:
        return int(edges[chain] + middle - begins[chain])
    away = np.abs(at - middle)  # the middle is before the chain, on one of the ways to it
    return int(places[rows[np.lexsort((-beliefs[rows], away))[0]]])


def _best(places: Places, beliefs: Beliefs, vicinity: Vicinity) -> tuple[Rows, Positions]:
    """Return the rows of the places in the window of highest belief, and their positions."""
    rows, at = _unfold(places, vicinity)
    first, end = _window(at, beliefs[rows], vicinity.tolerance)
    return rows[first:end], at[first:end]


def _apart(places: Places, vicinity: Vicinity) -> Positions:
    """Return the positions of places: as in the map, but no window reaches two chains."""
    chain = vicinity.chains.of(places).astype(np.int64)
    return np.asarray(places + (4 * vicinity.tolerance + 1) * chain)


def _unfold(places: Places, vicinity: Vicinity) -> tuple[Rows, Positions]:
    """Return positions of places, ascending, and their rows among the places.

    A place from which a passage leads to a chain has a position before that chain, too.
    """
    (edges, ahead, _), reach = vicinity.chains, 2 * vicinity.tolerance
    all_rows, all_at = [np.arange(len(places))], [_apart(places, vicinity)]
    begins = edges[ahead.target]
    shifts = ahead.shift.astype(np.int64)
    low = np.searchsorted(places, np.maximum(edges[ahead.source], begins + shifts - reach))
    high = np.searchsorted(places, edges[ahead.source + 1])
    for i in np.flatnonzero(low < high):
        rows = np.arange(low[i], high[i])
        all_rows.append(rows)
        all_at.append(places[rows] - shifts[i] - begins[i] + _apart(begins[i], vicinity))
    rows, at = np.concatenate(all_rows), np.concatenate(all_at)
    order = np.argsort(at, kind="stable")
    return rows[order], at[order]


def _near(middle: int, places: Places, vicinity: Vicinity) -> NDArray[np.bool_]:
    """Return which places are near a place by their steps."""
    ahead, tolerance = vicinity.chains.ahead, vicinity.tolerance
    chains = vicinity.chains.of(places)
    own = int(vicinity.chains.of(np.array(middle, np.int32)))
    near: NDArray[np.bool_] = (chains == own) & (np.abs(places - middle) <= tolerance)
    for i in np.flatnonzero((ahead.source == own) | (ahead.target == own)):
        source, target, shift = int(ahead.source[i]), int(ahead.target[i]), int(ahead.shift[i])
        if source == own:
            near |= (chains == target) & (places + shift - middle <= tolerance)
        if target == own:
            near |= (chains == source) & (middle + shift - places <= tolerance)
    return near


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
