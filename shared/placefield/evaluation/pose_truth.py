"""The right places of each query frame, by the positions of frames and places."""

import numpy as np
from numpy.typing import NDArray

from placefield.evaluation.truth import Truth

OFF_ROUTE_M = 25.0
"""A frame further than this from every place is off the route: the field's usual radius."""

_ROUNDED_M = 1e-6  # greatest rounding error of a sum of distances


def pose_truth(
    query: NDArray[np.float64],
    places: NDArray[np.float64],
    *,
    tolerance: int,
    metres: float | None = None,
) -> Truth:
    """Return the truth by distance: places near enough to the query frame are right.

    With `metres`, every place within that distance is right. Without it, the nearest place is
    right. So is every place whose distance from the frame exceeds that of the nearest place by at
    most the reach of `tolerance` places around the nearest place. A frame further than
    ``OFF_ROUTE_M`` from all places is off the route.

    A frame is not judged if its position is unknown, or if the nearest place is beside places of
    unknown position, because one of these may be nearer.

    Args:
        query: x and y of the frames, metres, (Q, 2); NaN where unknown.
        places: x and y of the places, in the same coordinate frame, (K, 2); NaN where unknown.
        tolerance: places, 0 or more; of no effect if metres are given.
        metres: greatest distance of a right place.
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
    """Return the greatest distance of the places at most so many before or after this one."""
    around = places[max(nearest - tolerance, 0) : nearest + tolerance + 1] - places[nearest]
    return float(np.nanmax(np.hypot(*around.T)))


def _runs(right: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(right, prepend=False, append=False))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]
