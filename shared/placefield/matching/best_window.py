"""The window of places that has most of a posterior."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel

Places = NDArray[np.int32]
Beliefs = NDArray[np.float32]


def twins_in(same: Places) -> Places | None:
    """Return which place each is the same as, (K,); None if all places differ."""
    return None if np.array_equal(same, np.arange(len(same))) else same


def best_window(
    places: Places, beliefs: Beliefs, tolerance: int, same: Places | None = None
) -> tuple[int, float]:
    """Return the middle of the window of highest belief, and the belief around the middle.

    Two places are near each other if they, or the places that they are the same as, are within the
    tolerance. So laps of one stretch share their belief; the middle is in the lap of highest
    belief.

    Args:
        places: (n,) int32, ascending; may contain duplicates.
        beliefs: (n,) float32; clipped to 0 to 1, because they may come from the bus.
        tolerance: places.
        same: (K,) int32, of the whole map, which place each is the same as; None: all differ.
    """
    if same is None:
        first, end = _window(places, beliefs, tolerance)
        middle = _middle(places[first:end], beliefs[first:end])
        return middle, _around(places, places, beliefs, (middle, middle), tolerance)
    shared = same[places]
    order = np.argsort(shared, kind="stable")
    first, end = _window(shared[order], beliefs[order], tolerance)
    laps = np.sort(order[first:end])
    middle = best_window(places[laps], beliefs[laps], tolerance)[0]
    return middle, _around(places, shared, beliefs, (middle, int(same[middle])), tolerance)


@kernel
def _window(places: Places, beliefs: Beliefs, tolerance: int) -> tuple[int, int]:
    """Return where the 2 tolerance + 1 consecutive places of highest belief begin and end."""
    best_first, best_end, best, end, within = 0, 0, -1.0, 0, 0.0
    for first in range(len(places)):
        while end < len(places) and places[end] <= places[first] + 2 * tolerance:
            within += min(max(beliefs[end], 0), 1)
            end += 1
        if within > best:
            best_first, best_end, best = first, end, within
        within -= min(max(beliefs[first], 0), 1)
    return best_first, best_end


@kernel
def _middle(places: Places, beliefs: Beliefs) -> int:
    """Return the mean of places, weighted by belief."""
    moment, weight = 0.0, 0.0
    for i in range(len(places)):
        belief = min(max(beliefs[i], 0), 1)
        moment += belief * places[i]
        weight += belief
    return round(moment / weight) if weight > 0 else int(places[0])


@kernel
def _around(
    places: Places, shared: Places, beliefs: Beliefs, middle: tuple[int, int], tolerance: int
) -> float:
    """Sum the belief near a place; ``middle`` is the place, and which place it is the same as."""
    around = 0.0
    for i in range(len(places)):
        if abs(places[i] - middle[0]) <= tolerance or abs(shared[i] - middle[1]) <= tolerance:
            around += min(max(beliefs[i], 0), 1)
    return around
