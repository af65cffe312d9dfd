"""Where a posterior over places has most of its mass."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel


@kernel
def best_window(
    places: NDArray[np.int32], beliefs: NDArray[np.float32], tolerance: int
) -> tuple[int, float]:
    """Find the middle of the window of most belief, and the belief around it.

    Places ascend and may come several times; beliefs count as 0 to 1, whatever came over the bus.
    """
    best_first, best_end, best, end, within = 0, 0, -1.0, 0, 0.0
    for first in range(len(places)):
        while end < len(places) and places[end] <= places[first] + 2 * tolerance:
            within += min(max(beliefs[end], 0), 1)
            end += 1
        if within > best:
            best_first, best_end, best = first, end, within
        within -= min(max(beliefs[first], 0), 1)
    moment, weight = 0.0, 0.0
    for i in range(best_first, best_end):
        belief = min(max(beliefs[i], 0), 1)
        moment += belief * places[i]
        weight += belief
    middle = round(moment / weight) if weight > 0 else int(places[best_first])
    around = 0.0
    for i in range(len(places)):
        if abs(places[i] - middle) <= tolerance:
            around += min(max(beliefs[i], 0), 1)
    return middle, around
