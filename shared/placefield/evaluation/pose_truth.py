"""Which places are right for each query frame, by where both were taken."""

import numpy as np
from numpy.typing import NDArray

from placefield.evaluation.truth import Truth

OFF_ROUTE_M = 25.0
"""A frame further than this from every place is off the route: the field's usual radius."""

_ROUNDED_M = 1e-6  # by as much sums of distances may be off


def pose_truth(
    query: NDArray[np.float64],
    places: NDArray[np.float64],
    *,
    tolerance: int,
    metres: float | None = None,
) -> Truth:
    """Take as right what is near enough.

    In metres, every place that is at most so far off is right. In places, the nearest one is, and
    what is at most further than it by as far as the place so many on is from it; a frame further
    than ``OFF_ROUTE_M`` from all is off the route.

    A frame is not judged where nobody knows where it was, or where the nearest place is beside
    places of which nobody knows where they are: one of these may be nearer.

    Args:
        query: x and y of the frames, metres, (Q, 2); NaN where nobody knows.
        places: of the places, in the same frame, (K, 2); likewise.
        tolerance: places, 0 or more; of no effect where metres are given.
        metres: how far off a right place is at most.
    """
    known = _known(places)
    beside_unknown = _beside(~known)
    judged = _known(query) & known.any()
    rows: list[tuple[int, int, int]] = []
    for frame in np.flatnonzero(judged):
        away = np.where(known, np.hypot(*(places - query[frame]).T), np.inf)
        nearest = int(away.argmin())
        if beside_unknown[nearest]:
            judged[frame] = False
            continue
        reach = metres
        if reach is None:
            on_route = away[nearest] <= OFF_ROUTE_M
            reach = (
                away[nearest] + _reach(places, nearest, tolerance) + _ROUNDED_M
                if on_route
                else -1.0
            )
        rows += [(int(frame), first, last) for first, last in _runs(away <= reach)]
    frames, first, last = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    return Truth(len(query), frames, first, last, judged)


def _known(positions: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.isfinite(positions[:, 0]) & np.isfinite(positions[:, 1])


def _beside(unknown: NDArray[np.bool_]) -> NDArray[np.bool_]:
    beside = np.zeros_like(unknown)
    beside[1:] |= unknown[:-1]
    beside[:-1] |= unknown[1:]
    return beside


def _reach(places: NDArray[np.float64], nearest: int, tolerance: int) -> float:
    """Return how far the places are that are at most so many before or after this one, metres."""
    around = places[max(nearest - tolerance, 0) : nearest + tolerance + 1] - places[nearest]
    return float(np.nanmax(np.hypot(*around.T)))


def _runs(right: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(right, prepend=False, append=False))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]
