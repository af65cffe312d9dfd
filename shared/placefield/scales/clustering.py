"""Fuzzy c-means of a traverse's descriptors (Eqs. 1 to 3)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, MapError
from placefield.scales.block_clustering import Stretches, cluster_in_blocks
from placefield.scales.placed import Placed

_TOLERANCE = 1e-3  # furthest move of a centre, in mean distances of frames to their nearest one
_MAX_SWEEPS = 100
_MOST_MEMBERSHIPS = 2**18  # of all frames in all clusters; for more, scikit-fuzzy takes longer

Vectors = NDArray[np.float64]
Progress = Callable[[int, int], None]
"""Called with the number of finished sweeps over the frames, and the most there may be."""


@dataclass(frozen=True)
class Clustering:
    """Fuzzy clusters of K frames.

    Attributes:
        centres: C of them, c_k of Eq. 1.
        labels: (K,) int32, each frame's cluster of highest membership, that of its nearest centre,
            0 to C - 1.
    """

    centres: Placed
    labels: NDArray[np.int32]


def cluster(
    frames: Placed,
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
        frames: K of them in route order.
        clusters: C, 1 to K.
        fuzzifier: m of Eq. 2, above 1; the higher, the softer. Descriptors of high dimension
            without the route's position begin to share centres at about 1.4.
        seed: of the stretches.
        progress: called after every sweep. An exception of it ends the clustering.

    If the (K, C) memberships are few, scikit-fuzzy clusters; else `cluster_in_blocks`, to the same
    labels.

    Raises:
        ConfigError: the fuzzifier is not above 1.
        MapError: there are fewer frames than clusters.
    """
    if fuzzifier <= 1:
        raise ConfigError(f"fuzzifier {fuzzifier:g} is too low: give one above 1, such as 1.1")
    if not 1 <= clusters <= frames.count:
        raise MapError(
            f"{frames.count} frames cannot form {clusters} clusters: "
            f"ask for 1 to {frames.count} clusters, or give more frames"
        )
    stretches = _stretches(frames.count, clusters, np.random.default_rng(seed))
    has_converged = _Convergence(progress)
    if frames.count * clusters <= _MOST_MEMBERSHIPS:
        found = _cluster_at_once(frames, stretches, fuzzifier, has_converged)
    else:
        found = cluster_in_blocks(frames, stretches, fuzzifier, has_converged)
    return Clustering(*found)


class _Convergence:
    """Counts and reports sweeps, and ends them when no centre moves far any more."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._done = progress, 0

    def __call__(self, moves: NDArray[np.floating[Any]], spread: float) -> bool:
        self._done += 1
        self._progress(self._done, _MAX_SWEEPS)
        return self._done == _MAX_SWEEPS or bool(moves.max() <= _TOLERANCE * spread)


def _cluster_at_once(
    frames: Placed, stretches: Stretches, fuzzifier: float, has_converged: _Convergence
) -> tuple[Placed, NDArray[np.int32]]:
    """Cluster by scikit-fuzzy, one sweep per call; it holds all memberships."""
    import skfuzzy  # takes a third of a second

    points = frames.exact().T
    numbers = np.arange(len(stretches) + 1)[:, None]
    memberships = np.searchsorted(stretches, np.arange(frames.count), "right") == numbers

    def sweep(memberships: NDArray[np.floating | np.bool_]) -> tuple[Vectors, Vectors, Vectors]:
        centres, changed, _, distances, *_ = skfuzzy.cmeans(
            points, len(memberships), fuzzifier, error=0, maxiter=1, init=memberships * 1.0
        )
        return centres, changed, distances

    means, memberships, distances = sweep(memberships)
    while True:
        centres, nearest = means, distances.argmin(axis=0)
        spread = float(distances.min(axis=0).mean())
        means, memberships, distances = sweep(memberships)
        if has_converged(np.linalg.norm(means - centres, axis=1), spread):
            vectors, positions = np.split(centres, [frames.vectors.shape[1]], axis=1)
            found = Placed(vectors.astype(np.float32), positions.sum(axis=1))  # one, or none: 0
            return found, nearest.astype(np.int32)


def _stretches(count: int, clusters: int, rng: np.random.Generator) -> Stretches:
    """Return where stretches of random lengths end, except the last; each has at least a frame."""
    return np.sort(rng.choice(np.arange(1, count), clusters - 1, replace=False))
