"""Sequence matching with one window of fixed length."""

import numpy as np
from numpy.typing import NDArray

from placefield.fusion.match import Match
from placefield.matching.candidate import UNANSWERED


def fixed_window(distances: NDArray[np.float32], length: int) -> list[Match]:
    """Match each query frame to the place of the lowest sum of distances over its window.

    The window compares the last ``length`` query frames with as many places, at one speed. With a
    length of 1 this is matching by the newest frame alone. Nothing is said before the first
    complete window.

    Args:
        distances: (Q, K) float32, of query frames to places.
        length: of the window, at least 1, frames.

    Returns:
        Q matches; the score is the negated sum.
    """
    return [_lowest(sums) for sums in window_sums(distances, length)]


def window_sums(
    distances: NDArray[np.floating], length: int, speed: float = 1.0
) -> NDArray[np.float64]:
    """Sum distances along the straight windows that end at each query frame t and place j.

    S(t, j) = sum over i = 0 .. length - 1 of D(t - i, j - round(speed i)).

    Args:
        distances: D, (Q, K) float.
        length: at least 1, query frames.
        speed: at least 0, places per query frame.

    Returns:
        S, (Q, K) float64; infinite where the window would begin before the first query frame or
        place.
    """
    queries, places = distances.shape
    steps = np.rint(speed * np.arange(length)).astype(int)
    reach = steps[-1]
    sums = np.full((queries, places), np.inf)
    if length <= queries and reach < places:
        complete = sums[length - 1 :, reach:]
        complete[:] = 0
        for i, step in enumerate(steps):
            complete += distances[length - 1 - i : queries - i, reach - step : places - step]
    return sums


def _lowest(sums: NDArray[np.float64]) -> Match:
    place = int(np.argmin(sums))
    if sums[place] == np.inf:
        return Match(UNANSWERED, 0.0)
    return Match(place, -float(sums[place]))
