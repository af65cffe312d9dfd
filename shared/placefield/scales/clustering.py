"""Fuzzy c-means of a traverse's descriptors (Eqs. 1 to 3)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.errors import ConfigError, MapError
from placefield.metric.squared_distances import squared_distances

_TOLERANCE = 1e-3  # furthest move of a centre, in mean distances of frames to their nearest one
_MAX_SWEEPS = 100
_LEAST_LOG = (
    -36.0
)  # least log of a membership, so that a centre far from all frames moves to their middle
_BLOCK = 512  # frames whose memberships are held at once
_RELATED = (
    20  # frames; at weight 1, frames so far apart differ as much by position as by descriptor
)

_MOST_MEMBERSHIPS = 2**24  # 128 MB, of which scikit-fuzzy holds several

Vectors = NDArray[np.float64]
Stretches = NDArray[np.integer]
Progress = Callable[[int, int], None]
"""Called with the number of finished sweeps over the frames, and the most there may be."""


@dataclass(frozen=True)
class Clustering:
    """Fuzzy clusters of K frames.

    Attributes:
        centres: (C, N) float64, c_k of Eq. 1.
        labels: (K,) int32, each frame's cluster of highest membership, that of its nearest centre,
            0 to C - 1.
    """

    centres: Vectors
    labels: NDArray[np.int32]


def cluster(
    vectors: NDArray[np.float32],
    clusters: int,
    fuzzifier: float,
    seed: int,
    progress: Progress = lambda done, total: None,
) -> Clustering:
    """Cluster a traverse by fuzzy c-means.

    The search starts from consecutive stretches of the route, which leads to fewer and longer
    segments than random memberships do. The seed determines where the stretches end. The result
    depends on it, so another seed gives another, overlapping clustering.

    Args:
        vectors: (K, N) float32 in route order.
        clusters: C, 1 to K.
        fuzzifier: m of Eq. 2, above 1; the higher, the softer. Descriptors of high dimension
            without the route's position begin to share centres at about 1.4.
        seed: of the stretches.
        progress: called after every sweep. An exception of it ends the clustering.

    If the (K, C) memberships fit in memory, scikit-fuzzy clusters; else `cluster_in_blocks`.

    Raises:
        ConfigError: the fuzzifier is not above 1.
        MapError: there are fewer frames than clusters.
    """
    if fuzzifier <= 1:
        raise ConfigError(f"fuzzifier {fuzzifier:g} is too low: give one above 1, such as 1.1")
    if not 1 <= clusters <= len(vectors):
        raise MapError(
            f"{len(vectors)} frames cannot form {clusters} clusters: "
            f"ask for 1 to {len(vectors)} clusters, or give more frames"
        )
    stretches = _stretches(len(vectors), clusters, np.random.default_rng(seed))
    if len(vectors) * clusters <= _MOST_MEMBERSHIPS:
        return _cluster_at_once(vectors, stretches, fuzzifier, progress)
    return cluster_in_blocks(vectors, stretches, fuzzifier, progress)


def _cluster_at_once(
    vectors: NDArray[np.float32], stretches: Stretches, fuzzifier: float, progress: Progress
) -> Clustering:
    """Cluster by scikit-fuzzy, one sweep per call; it holds all memberships."""
    import skfuzzy  # takes a third of a second

    points = vectors.T.astype(np.float64)
    numbers = np.arange(len(stretches) + 1)[:, None]
    memberships = np.searchsorted(stretches, np.arange(len(vectors)), "right") == numbers

    def sweep(memberships: NDArray[np.floating | np.bool_]) -> tuple[Vectors, Vectors, Vectors]:
        centres, changed, _, distances, *_ = skfuzzy.cmeans(
            points, len(memberships), fuzzifier, error=0, maxiter=1, init=memberships * 1.0
        )
        return centres, changed, distances

    means, memberships, distances = sweep(memberships)
    for done in range(1, _MAX_SWEEPS + 1):
        centres, labels = means, distances.argmin(axis=0).astype(np.int32)
        progress(done, _MAX_SWEEPS)
        spread = float(distances.min(axis=0).mean())
        means, memberships, distances = sweep(memberships)
        if _has_converged(centres, means, spread):
            break
    return Clustering(centres, labels)


def cluster_in_blocks(
    vectors: NDArray[np.float32],
    stretches: Stretches,
    fuzzifier: float,
    progress: Progress = lambda done, total: None,
) -> Clustering:
    """Cluster with only a block of the memberships in memory.

    This is our own code because scikit-fuzzy needs all memberships: five arrays of 0.9 GB each for
    30 000 frames and 4000 clusters.

    Args:
        vectors: (K, N) float32.
        stretches: (C - 1,) int, where the initial stretches end, see `cluster`.
        fuzzifier: m.
        progress: called after every sweep.
    """
    means = _stretch_means(vectors, stretches)
    for sweep in range(1, _MAX_SWEEPS + 1):
        centres = means
        labels, means, spread = _sweep(vectors, centres, fuzzifier)
        progress(sweep, _MAX_SWEEPS)
        if _has_converged(centres, means, spread):
            break
    return Clustering(centres, labels)


def _has_converged(before: Vectors, centres: Vectors, spread: float) -> bool:
    return bool(np.linalg.norm(centres - before, axis=1).max() <= _TOLERANCE * spread)


def with_route_position(vectors: NDArray[np.float32], weight: float) -> NDArray[np.float32]:
    """Append each frame's position in the route, so that clusters become consecutive.

    At weight 1, the position separates two frames that are 20 apart as far as the descriptors
    separate two random frames (whose mean squared distance is twice the total variance). The
    position counts in frames, so one weight suits routes of every length.

    Args:
        vectors: (K, N) float32 in route order.
        weight: of the position; 0, the paper's clustering, does not change the vectors.

    Returns:
        (K, N + 1) float32, or (K, N) for weight 0.
    """
    if weight == 0:
        return vectors
    step = weight * np.sqrt(2 * vectors.var(axis=0, dtype=np.float64).sum()) / _RELATED
    return np.column_stack([vectors, step * np.arange(len(vectors))]).astype(np.float32)


def _stretches(count: int, clusters: int, rng: np.random.Generator) -> Stretches:
    """Return where stretches of random lengths end, except the last; each has at least a frame."""
    return np.sort(rng.choice(np.arange(1, count), clusters - 1, replace=False))


def _stretch_means(vectors: NDArray[np.float32], stretches: Stretches) -> Vectors:
    starts = np.r_[0, stretches]
    sums = np.add.reduceat(vectors, starts, axis=0, dtype=np.float64)
    return np.asarray(sums / np.diff(starts, append=len(vectors))[:, None])


def _sweep(
    vectors: NDArray[np.float32], centres: Vectors, fuzzifier: float
) -> tuple[NDArray[np.int32], Vectors, float]:
    """Return each frame's label, the means (C, N) by the memberships, and the mean distance."""
    labels = np.empty(len(vectors), np.int32)
    sums = np.zeros_like(centres)
    weights = np.zeros(len(centres))
    spread = 0.0
    for rows in blocks(len(vectors), _BLOCK):
        # In float32 the position in a long route would cost the product its digits.
        block = vectors[rows].astype(np.float64)
        squared = squared_distances(block, centres)
        labels[rows] = squared.argmin(axis=1)
        spread += np.sqrt(squared.min(axis=1)).sum()
        powers = _powers(squared, fuzzifier)
        sums += powers.T @ block
        weights += powers.sum(axis=0)
    return labels, sums / weights[:, None], float(spread / len(vectors))


def _powers(squared: Vectors, fuzzifier: float) -> Vectors:
    """Return µ^m of Eqs. 1 and 2, (K, C), of squared distances to the centres, (K, C).

    Logarithms of the ratios to the nearest centre neither overflow nor all vanish. They are of
    order 1 where a membership counts, so float32 is enough, which is several times as fast.
    """
    squared = np.maximum(squared, np.finfo(np.float64).tiny)
    ratios = (squared.min(axis=1, keepdims=True) / squared).astype(np.float32)
    logs = np.log(np.maximum(ratios, np.finfo(np.float32).tiny)) / np.float32(fuzzifier - 1)
    logs -= np.log(np.exp(logs).sum(axis=1, keepdims=True))
    powers: NDArray[np.float32] = np.exp(
        np.float32(fuzzifier) * np.maximum(logs, np.float32(_LEAST_LOG))
    )
    return powers.astype(np.float64)
