"""Estimate the number of clusters by subtractive clustering (Chiu, 1994).

S. L. Chiu, "Fuzzy model identification based on cluster estimation", Journal of Intelligent and
Fuzzy Systems 2(3), 1994. Every frame is a candidate centre. The more frames lie near it, the higher
its potential. The candidate of the highest potential becomes a centre and lowers the potentials of
its neighbours, until all that are left are low.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.metric.squared_distances import squared_distances


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

Vectors = NDArray[np.float32]
Array64 = NDArray[np.float64]


def estimate_clusters(vectors: Vectors, radius: Radius) -> int:
    """Estimate how many clusters a traverse holds.

    Time grows with K² N, memory with K.

    Args:
        vectors: (K, N) float32 descriptors in route order, K >= 1, with the route's position
            (`with_route_position`) or without.
        radius: of a cluster.

    Returns:
        The number of centres, 1 to K.
    """
    cluster_radius = radius.times * _neighbour_distance(vectors, radius.apart)
    return 1 if cluster_radius == 0 else _count_centres(vectors, cluster_radius)


def _neighbour_distance(vectors: Vectors, apart: int) -> float:
    if len(vectors) == 1:
        return 0.0
    apart = min(apart, len(vectors) - 1)
    total = 0.0
    for start in range(0, len(vectors) - apart, _BLOCK):
        later = vectors[start + apart : start + apart + _BLOCK].astype(np.float64)
        steps = later - vectors[start : start + len(later)]
        total += np.einsum("kn,kn->", steps, steps)
    return float(np.sqrt(total / (len(vectors) - apart)))


def _count_centres(vectors: Vectors, radius: float) -> int:
    potentials = _potentials(vectors, radius)
    highest = potentials.max()
    to_nearest_centre = np.full(len(vectors), np.inf)
    centres = 0
    while True:
        candidate = int(potentials.argmax())
        ratio = potentials[candidate] / highest
        if ratio < _REJECT:
            return centres
        # Between the two fractions, a candidate of less potential must be further from all centres.
        if ratio > _ACCEPT or to_nearest_centre[candidate] / radius + ratio >= 1:
            centres += 1
            squared = _squared_distances_to(vectors, vectors[candidate])
            to_nearest_centre = np.minimum(to_nearest_centre, np.sqrt(squared))
            potentials -= potentials[candidate] * _nearness(squared, _SQUASH * radius)
        potentials[candidate] = 0


def _potentials(vectors: Vectors, radius: float) -> Array64:
    potentials = np.zeros(len(vectors))
    for rows in blocks(len(vectors), _BLOCK):
        for columns in blocks(len(vectors), _BLOCK):
            squared = _squared_distances(vectors[rows], vectors[columns])
            potentials[rows] += _nearness(squared, radius).sum(axis=1)
    return potentials


def _nearness(squared: Array64, radius: float) -> Array64:
    nearness: Array64 = np.exp(-4 / radius**2 * squared)
    return nearness


def _squared_distances_to(vectors: Vectors, vector: Vectors) -> Array64:
    squared = np.empty(len(vectors))
    for rows in blocks(len(vectors), _BLOCK):
        squared[rows] = _squared_distances(vectors[rows], vector[None])[:, 0]
    return squared


def _squared_distances(rows: Vectors, columns: Vectors) -> Array64:
    """Return distances in float64: in float32 positions in a long route have few digits."""
    return squared_distances(rows.astype(np.float64), columns.astype(np.float64))
