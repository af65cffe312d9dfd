"""Where a posterior over places has most of its mass."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel

Places = NDArray[np.int32]
Beliefs = NDArray[np.float32]


def twins_in(same: Places) -> Places | None:
    """Return which place each is the same as, (K,); None where every place is one of its own."""
    return None if np.array_equal(same, np.arange(len(same))) else same


def best_window(
    places: Places, beliefs: Beliefs, tolerance: int, same: Places | None = None
) -> tuple[int, float]:
    """Find the middle of the window of most belief, and the belief around it.

    A place is near another if it is within the tolerance of it, or if what the one is the same as
    is within the tolerance of what the other is the same as. So laps of one stretch share their
    belief; the middle is in the lap that has most of it.

    Args:
        places: (n,) int32, ascending; they may come several times.
        beliefs: (n,) float32; they count as 0 to 1, whatever came over the bus.
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
    """Return where the 2 tolerance + 1 consecutive places of most belief begin and end."""
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
    """Sum up the belief near a place, given with what it is the same as, like the others."""
    around = 0.0
    for i in range(len(places)):
        if abs(places[i] - middle[0]) <= tolerance or abs(shared[i] - middle[1]) <= tolerance:
            around += min(max(beliefs[i], 0), 1)
    return around
