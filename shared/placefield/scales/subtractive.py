"""Estimate the number of clusters by subtractive clustering (Chiu, 1994).

S. L. Chiu, "Fuzzy model identification based on cluster estimation", Journal of Intelligent and
Fuzzy Systems 2(3), 1994. Every frame is a candidate centre, and the more frames lie near it, the
higher its potential. The highest becomes a centre and takes its share from its neighbours'
potentials, until what is left is low.
"""

import numpy as np
from numpy.typing import NDArray

_NEIGHBOURS = 8  # frames apart: a short segment; a fast camera's next frame would be too near
_SQUASH = 1.5  # radius in which a new centre lowers potentials, in cluster radii
_ACCEPT = 0.5  # above this share of the first centre's potential a candidate is a centre
_REJECT = 0.15  # below it the search ends
_BLOCK = 256  # frames whose distances to all others are held at once

Vectors = NDArray[np.float64]


def estimate_clusters(vectors: NDArray[np.float32], radius: float = 1.25) -> int:
    """Estimate how many clusters a traverse holds.

    Time grows with K² N, memory with K.

    Args:
        vectors: (K, N) float32 descriptors in route order, K >= 1. Descriptors of high dimension
            need the route's position with them (`with_route_position`): as all frames are nearly
            equally far apart, the many unrelated ones otherwise drown a frame's neighbours.
        radius: of a cluster, in distances of neighbours (root mean square over all frames 8
            apart: unlike a median, it does not vanish where the vehicle mostly stands still).

    Returns:
        The number of centres, 1 to K.
    """
    points = vectors.astype(np.float64)
    cluster_radius = radius * _neighbour_distance(points)
    return 1 if cluster_radius == 0 else _count_centres(points, cluster_radius)


def _neighbour_distance(points: Vectors) -> float:
    if len(points) == 1:
        return 0.0
    apart = min(_NEIGHBOURS, len(points) - 1)
    differences = points[apart:] - points[:-apart]
    return float(np.sqrt((differences**2).sum(axis=1).mean()))


def _count_centres(points: Vectors, radius: float) -> int:
    potentials = _potentials(points, radius)
    highest = potentials.max()
    to_nearest_centre = np.full(len(points), np.inf)
    centres = 0
    while True:
        candidate = int(potentials.argmax())
        share = potentials[candidate] / highest
        if share < _REJECT:
            return centres
        # Between the two ratios, a candidate must make up in distance what it lacks in potential.
        if share > _ACCEPT or to_nearest_centre[candidate] / radius + share >= 1:
            centres += 1
            squared = _squared_distances(points[candidate : candidate + 1], points)[0]
            to_nearest_centre = np.minimum(to_nearest_centre, np.sqrt(squared))
            potentials -= potentials[candidate] * _nearness(squared, _SQUASH * radius)
        potentials[candidate] = 0


def _potentials(points: Vectors, radius: float) -> Vectors:
    blocks = np.split(points, range(_BLOCK, len(points), _BLOCK))
    return np.concatenate(
        [_nearness(_squared_distances(block, points), radius).sum(axis=1) for block in blocks]
    )


def _nearness(squared: Vectors, radius: float) -> Vectors:
    nearness: Vectors = np.exp(-4 / radius**2 * squared)
    return nearness


def _squared_distances(a: Vectors, b: Vectors) -> Vectors:
    norms = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)
    squared: Vectors = np.maximum(norms - 2 * a @ b.T, 0)
    return squared
