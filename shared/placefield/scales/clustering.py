"""Fuzzy c-means of a traverse's descriptors (Eqs. 1 to 3)."""

from dataclasses import dataclass

import numpy as np
import skfuzzy
from numpy.typing import NDArray

from placefield.errors import ConfigError, MapError

_TOLERANCE = 1e-2  # change of the memberships (Frobenius norm) at which they have converged
_MAX_ITERATIONS = 100
_RELATED = 20  # frames apart, at position weight 1, to be as far by position as by descriptor


@dataclass(frozen=True)
class Clustering:
    """Fuzzy clusters of K frames.

    Attributes:
        centres: (C, N) float32, c_k of Eq. 1.
        memberships: (K, C) float32, µ of Eq. 2; a frame's memberships sum to 1.
        labels: (K,) int32, each frame's cluster of highest membership, 0 to C - 1.
    """

    centres: NDArray[np.float32]
    memberships: NDArray[np.float32]
    labels: NDArray[np.int32]


def cluster(vectors: NDArray[np.float32], clusters: int, fuzzifier: float, seed: int) -> Clustering:
    """Cluster a traverse by fuzzy c-means.

    The search starts from consecutive stretches of the route, which leads to fewer and longer
    segments than random memberships do. The seed draws where the stretches end: the end result
    keeps a trace of it, so that another seed gives another, overlapping clustering.

    Args:
        vectors: (K, N) float32 in route order.
        clusters: C, 1 to K.
        fuzzifier: m of Eq. 2, above 1; the higher, the softer. Descriptors of high dimension
            without the route's position begin to share centres at about 1.4.
        seed: of the stretches.

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
    centres, memberships, *_ = skfuzzy.cmeans(
        vectors.T.astype(np.float64),
        clusters,
        fuzzifier,
        error=_TOLERANCE,
        maxiter=_MAX_ITERATIONS,
        init=_stretches(len(vectors), clusters, np.random.default_rng(seed)),
    )
    return Clustering(
        centres.astype(np.float32),
        memberships.T.astype(np.float32),
        memberships.argmax(axis=0).astype(np.int32),
    )


def with_route_position(vectors: NDArray[np.float32], weight: float) -> NDArray[np.float32]:
    """Append each frame's position in the route, so that clusters become consecutive.

    Weight 1 puts two frames that are 20 apart as far from each other by position as two frames
    drawn at random are by descriptor (whose mean squared distance is twice the total variance).
    Because it counts in frames, one weight suits routes of every length.

    Args:
        vectors: (K, N) float32 in route order.
        weight: of the position; 0, the paper's clustering, leaves the vectors as they are.

    Returns:
        (K, N + 1) float32, or (K, N) for weight 0.
    """
    if weight == 0:
        return vectors
    step = weight * np.sqrt(2 * vectors.var(axis=0, dtype=np.float64).sum()) / _RELATED
    return np.column_stack([vectors, step * np.arange(len(vectors))]).astype(np.float32)


def _stretches(frames: int, clusters: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Memberships (C, K) of consecutive stretches of random lengths, each at least a frame long."""
    ends = np.sort(rng.choice(np.arange(1, frames), clusters - 1, replace=False))
    stretch = np.searchsorted(ends, np.arange(frames), side="right")
    return np.eye(clusters)[:, stretch]
