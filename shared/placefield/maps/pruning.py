"""Chooses the looks of a drive that add something to what a map has of its places."""

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.search.quantized import Quantized

MOST_LOOKS = 8
"""The most looks of a place: each costs as much as a place, in memory and in time."""


def looks_that_add(
    metric: MapMetric, shown: NDArray[np.int32], observed: Quantized
) -> NDArray[np.bool_]:
    """Return which looks add something, (n,) bool.

    A look adds nothing if it is nearer to the place's descriptor, or to one of its looks, than
    neighbouring places typically are to each other. A place with ``MOST_LOOKS`` gets no more.

    Args:
        metric: the identity metric, with the looks that the map has.
        shown: (n,) int32, the place of each look, ascending and distinct.
        observed: (n, N) int16, the quantized descriptors of the looks.
    """
    distances = _apart(metric.places[shown], observed)
    counts = np.zeros(len(shown), np.intp)
    if metric.looks is not None:
        at, rows = metric.looks.rows_of(shown)
        known = _apart(metric.looks.descriptors[rows], observed[at])
        np.minimum.at(distances, at, known)
        counts = np.bincount(at, minlength=len(shown))
    typical = float(np.median(metric.steps[0])) / metric.unit
    return np.asarray((distances >= typical) & (counts < MOST_LOOKS))


def _apart(one: Quantized, other: Quantized) -> NDArray[np.float64]:
    """Return the distances of vectors (n, N) from others, row by row, (n,)."""
    return np.asarray(np.linalg.norm(one.astype(np.float64) - other, axis=1))
