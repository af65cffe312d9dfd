"""Estimate the number of clusters by subtractive clustering (Chiu, 1994).

S. L. Chiu, "Fuzzy model identification based on cluster estimation", Journal of Intelligent and
Fuzzy Systems 2(3), 1994. Every frame is a candidate centre. The more frames lie near it, the higher
its potential. The candidate of the highest potential becomes a centre and lowers the potentials of
its neighbours, until all that are left are low.
"""

from collections.abc import Callable
from dataclasses import dataclass
from heapq import heapify, heapreplace

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.metric.squared_distances import squared_distances
from placefield.scales.placed import Placed


@dataclass(frozen=True)
class Radius:
    """The radius of a cluster, in distances of neighbours.

    Attributes:
        times: how many of these distances.
        apart: how many frames neighbours are from each other. Their distance is the root mean
            square over all frames: unlike a median, it does not vanish if the vehicle is mostly
            stationary.
    """

    times: float
    apart: int


PLACED = Radius(1.25, 8)
"""For vectors with the route's position: 8 frames are a short segment."""

UNPLACED = Radius(0.9, 4)
"""For descriptors alone. In high dimension they are nearly equally far from each other: in a wider
circle unrelated frames outnumber a frame's neighbours, and a whole route becomes one cluster.
"""

_SQUASH = 1.5  # radius in which a new centre lowers potentials, in cluster radii
_ACCEPT = 0.5  # above this fraction of the first centre's potential a candidate is a centre
_REJECT = 0.15  # below it the search ends
_BLOCK = 512  # frames whose distances to as many others are held at once
_FAR = 4.0  # radii; exp(-4 * 4²), of a block of frames too, is lost in the digits of a potential
_TO_POTENTIALS = 0.6  # of the time: so much for the potentials, the rest to count centres

Array64 = NDArray[np.float64]
Progress = Callable[[float], None]
"""Called with the fraction of the work that is done."""


def estimate_clusters(
    frames: Placed, radius: Radius, progress: Progress = lambda share: None
) -> int:
    """Estimate how many clusters a traverse holds.

    Frames that are far apart on the route do not change each other's potentials, and are not
    compared: time grows with K N. Without positions, it grows with K² N. Memory grows with K.

    Args:
        frames: K >= 1 in route order.
        radius: of a cluster.
        progress: an exception of it ends the work.

    Returns:
        The number of centres, 1 to K.
    """
    cluster_radius = radius.times * _neighbour_distance(frames, radius.apart)
    if cluster_radius == 0:
        return 1
    potentials = _potentials(frames, cluster_radius, lambda share: progress(_TO_POTENTIALS * share))

    def counted(share: float) -> None:
        progress(_TO_POTENTIALS + (1 - _TO_POTENTIALS) * share)

    return _count_centres(frames, cluster_radius, potentials, counted)


def _neighbour_distance(frames: Placed, apart: int) -> float:
    if frames.count == 1:
        return 0.0
    apart = min(apart, frames.count - 1)
    total = 0.0
    for rows in blocks(frames.count - apart, _BLOCK):
        steps = frames.exact(slice(rows.start + apart, rows.stop + apart)) - frames.exact(rows)
        total += np.einsum("kn,kn->", steps, steps)
    return float(np.sqrt(total / (frames.count - apart)))


def _count_centres(frames: Placed, radius: float, potentials: Array64, progress: Progress) -> int:
    """Count centres; the frame of the highest potential is the first of a heap."""
    highest = potentials.max()
    to_nearest_centre = np.full(frames.count, np.inf)
    candidates = [(-potential, frame) for frame, potential in enumerate(potentials.tolist())]
    heapify(candidates)
    centres = 0
    while True:
        negative, candidate = candidates[0]
        potential = potentials[candidate]
        if potential != -negative:  # a centre has lowered it
            heapreplace(candidates, (-float(potential), candidate))
            continue
        ratio = potential / highest
        if ratio < _REJECT:
            return centres
        # Between the two fractions, a candidate of less potential must be further from all centres.
        if ratio > _ACCEPT or to_nearest_centre[candidate] / radius + ratio >= 1:
            centres += 1
            centre = frames.exact(slice(candidate, candidate + 1))
            rows = _within(frames, slice(candidate, candidate + 1), _FAR * _SQUASH * radius)
            squared = squared_distances(frames.exact(rows), centre)[:, 0]
            to_nearest_centre[rows] = np.minimum(to_nearest_centre[rows], np.sqrt(squared))
            potentials[rows] -= potential * _nearness(squared, _SQUASH * radius)
            progress((1 - ratio) / (1 - _REJECT))
        potentials[candidate] = 0


def _potentials(frames: Placed, radius: float, progress: Progress) -> Array64:
    potentials = np.zeros(frames.count)
    for rows in blocks(frames.count, _BLOCK):
        block = frames.exact(rows)
        near = _within(frames, rows, _FAR * radius)
        for number in range(near.start // _BLOCK, -(-near.stop // _BLOCK)):
            columns = frames.exact(slice(number * _BLOCK, (number + 1) * _BLOCK))
            potentials[rows] += _nearness(squared_distances(block, columns), radius).sum(axis=1)
        progress(rows.stop / frames.count)
    return potentials


def _within(frames: Placed, rows: slice, reach: float) -> slice:
    """Return the frames that are within reach of some on the route."""
    positions = frames.positions
    first = np.searchsorted(positions, positions[rows.start] - reach)
    return slice(
        int(first), int(np.searchsorted(positions, positions[rows.stop - 1] + reach, "right"))
    )


def _nearness(squared: Array64, radius: float) -> Array64:
    nearness: Array64 = np.exp(-4 / radius**2 * squared)
    return nearness
