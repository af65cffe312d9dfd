"""Fuzzy c-means of a long traverse, of whose memberships only a block is held at once.

The position sets what is far apart on the route far apart in distance, so a frame has memberships
that count only in clusters near it on the route. The others are left out: the time grows with the
frames, not with frames times clusters. Without positions, all clusters are near.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.metric.squared_distances import squared_distances
from placefield.scales.placed import Placed

_BLOCK = 128  # frames whose memberships are held at once
_LEAST_LOG = (
    -36.0
)  # least log of a membership, so that a centre far from all frames moves to their middle
_LEAST_POWER = 2.0**-24  # a smaller part of a sum is lost in float32

Labels = NDArray[np.int32]
Stretches = NDArray[np.integer]
Floats = NDArray[np.float32]


def cluster_in_blocks(
    frames: Placed,
    stretches: Stretches,
    fuzzifier: float,
    has_converged: Callable[[NDArray[np.floating], float], bool],
) -> tuple[Placed, Labels]:
    """Cluster with only a block of the memberships in memory.

    This is our own code because scikit-fuzzy needs all memberships: five arrays of 0.9 GB each for
    30 000 frames and 4000 clusters.

    Args:
        frames: K of them, with ascending positions.
        stretches: (C - 1,) int, where the initial stretches end, ascending; none is empty.
        fuzzifier: m.
        has_converged: called after every sweep over the frames, with how far each centre moves and
            the mean distance of frames to their nearest centre; says whether to end.

    Returns:
        The C centres, and the number of the nearest one to each frame, (K,) int32.
    """
    labels = np.searchsorted(stretches, np.arange(frames.count), "right").astype(np.int32)
    means = _stretch_means(frames, stretches)
    while True:
        centres = means
        labels, means, spread = _sweep(frames, centres, labels, fuzzifier)
        if has_converged(np.sqrt(_squared_steps(centres, means)), spread):
            return centres, labels


def _stretch_means(frames: Placed, stretches: Stretches) -> Placed:
    starts = np.r_[0, stretches]
    counts = np.diff(starts, append=frames.count)
    sums = np.add.reduceat(frames.vectors, starts, axis=0)
    positions = np.add.reduceat(frames.positions, starts, dtype=np.float64)
    return Placed(sums / counts[:, None].astype(np.float32), positions / counts)


def _sweep(
    frames: Placed, centres: Placed, labels: Labels, fuzzifier: float
) -> tuple[Labels, Placed, float]:
    """Return the nearest centres, the means by the memberships, and the mean distance.

    Args:
        frames: K of them.
        centres: C of them.
        labels: (K,) int32, any centre of each frame; the nearer it is, the fewer memberships are
            computed.
        fuzzifier: m.
    """
    nearest, spread = np.empty_like(labels), 0.0
    sums = Placed(np.zeros_like(centres.vectors), np.zeros(centres.count))
    weights = np.zeros(centres.count)
    order = np.argsort(centres.positions, kind="stable")
    ascending = centres.positions[order]
    for rows in blocks(frames.count, _BLOCK):
        block = frames.rows(rows)
        within = _reach(block, centres.rows(labels[rows]), fuzzifier)
        first, end = (
            np.searchsorted(ascending, within[0]),
            np.searchsorted(ascending, within[1], "right"),
        )
        near = order[first:end]
        squared = _squared_between(block, centres.rows(near))
        least = squared.min(axis=1)
        nearest[rows] = near[squared.argmin(axis=1)]
        spread += float(np.sqrt(least).sum(dtype=np.float64))
        powers = _powers(squared, least, fuzzifier)
        sums.vectors[near] += powers.T @ block.vectors
        sums.positions[near] += powers.T.astype(np.float64) @ block.positions
        weights[near] += powers.sum(axis=0, dtype=np.float64)
    return nearest, _means(sums, weights, centres), spread / frames.count


def _reach(block: Placed, own: Placed, fuzzifier: float) -> tuple[float, float]:
    """Return from where to where on the route centres lie whose memberships count.

    A centre lies at least as far from a frame as their positions are apart, and the nearest one at
    most as far as any. So further away, µ^m of Eqs. 1 and 2 is below ``_LEAST_POWER``.

    Args:
        block: frames.
        own: a centre of each frame.
        fuzzifier: m.
    """
    farthest = float(np.sqrt(_squared_steps(block, own).max()))
    reach = farthest * _LEAST_POWER ** ((1 - fuzzifier) / (2 * fuzzifier))
    return float(block.positions[0]) - reach, float(block.positions[-1]) + reach


def _squared_steps(one: Placed, other: Placed) -> NDArray[np.float64]:
    """Return ‖x_i − y_i‖², (n,)."""
    steps = one.vectors - other.vectors
    apart = one.positions - other.positions
    return np.asarray(np.einsum("kn,kn->k", steps, steps) + apart**2, np.float64)


def _squared_between(frames: Placed, centres: Placed) -> Floats:
    """Return ‖x_i − c_k‖², (B, C).

    Positions are subtracted first: in a long route their squares have too few digits.
    """
    squared = squared_distances(frames.vectors, centres.vectors)
    apart = np.subtract.outer(frames.positions, centres.positions).astype(np.float32)
    squared += apart * apart
    return squared


def _powers(squared: Floats, least: Floats, fuzzifier: float) -> Floats:
    """Return µ^m of Eqs. 1 and 2, (B, C).

    Logarithms of the ratios to the nearest centre neither overflow nor all vanish. They are of
    order 1 where a membership counts, so float32 is enough, which is several times as fast.

    Args:
        squared: (B, C), squared distances to the centres.
        least: (B,), the least of each row.
        fuzzifier: m.
    """
    tiny = np.finfo(np.float32).tiny
    ratios = np.maximum(least, tiny)[:, None] / np.maximum(squared, tiny)
    logs = np.log(np.maximum(ratios, tiny)) / np.float32(fuzzifier - 1)
    logs -= np.log(np.exp(logs).sum(axis=1, keepdims=True))
    return np.exp(np.float32(fuzzifier) * np.maximum(logs, np.float32(_LEAST_LOG)))


def _means(sums: Placed, weights: NDArray[np.float64], before: Placed) -> Placed:
    """Return the weighted means; a centre that is near no frame stays where it was."""
    is_near = weights > 0
    divisors = np.where(is_near, weights, 1.0)
    vectors = np.divide(sums.vectors, divisors[:, None], dtype=np.float32, casting="same_kind")
    vectors[~is_near] = before.vectors[~is_near]
    return Placed(vectors, np.where(is_near, sums.positions / divisors, before.positions))
