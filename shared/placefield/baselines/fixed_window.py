"""Sequence matching with one window of fixed length."""

import numpy as np
from numpy.typing import NDArray

from placefield.fusion.match import Match
from placefield.matching.candidate import UNANSWERED


def fixed_window(distances: NDArray[np.float32], length: int, lag: int = 0) -> list[Match]:
    """Match each query frame to the place of the lowest sum of distances over its window.

    The window compares ``length`` query frames with as many places, at one speed: the last frames,
    or those around the frame as far as the lag allows, see ``window_sums``. With a length of 1 this
    is matching by single frames. Frames without a complete window are not answered.

    Args:
        distances: (Q, K) float32, of query frames to places.
        length: of the window, at least 1, frames.
        lag: how many frames after the matched one the window may use, at least 0.

    Returns:
        Q matches; the score is the negated sum.
    """
    return [_lowest(sums) for sums in window_sums(distances, length, lag=lag)]


def window_sums(
    distances: NDArray[np.floating], length: int, speed: float = 1.0, lag: int = 0
) -> NDArray[np.float64]:
    """Sum distances along the straight windows through each query frame t and place j.

    S(t, j) = sum over i = -a .. length - 1 - a of D(t - i, j - round(speed i)),

    where a = min(lag, length // 2) frames of the window come after t: none without a lag, and half
    of them if the lag allows, so that the window is centred.

    Args:
        distances: D, (Q, K) float.
        length: at least 1, query frames.
        speed: at least 0, places per query frame.
        lag: at least 0, query frames.

    Returns:
        S, (Q, K) float64; infinite where the window would begin before the first query frame or
        place, or end after the last one.
    """
    queries, places = distances.shape
    after = min(lag, length // 2)
    offsets = np.arange(-after, length - after)
    steps = np.rint(speed * offsets).astype(int)
    beyond, behind = -steps[0], steps[-1]
    sums = np.full((queries, places), np.inf)
    if length <= queries and beyond + behind < places:
        complete = sums[length - 1 - after : queries - after, behind : places - beyond]
        complete[:] = 0
        for i, step in zip(offsets, steps, strict=True):
            first = length - 1 - after - i
            of_frames = distances[first : first + len(complete)]
            complete += of_frames[:, behind - step : places - beyond - step]
    return sums


def _lowest(sums: NDArray[np.float64]) -> Match:
    place = int(np.argmin(sums))
    if sums[place] == np.inf:
        return Match(UNANSWERED, 0.0)
    return Match(place, -float(sums[place]))
