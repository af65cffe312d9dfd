"""How much likelier a number of inliers is between views of one place than of two places."""

import numpy as np
from numpy.typing import NDArray

_CONTINUOUS = 0.5  # added to a count, so that a pair without inliers has a density, too
_LEAST = 1e-150  # of a density, so that ratios of products are finite

Array = NDArray[np.float64]


def learn_ratios(same: NDArray[np.integer], other: NDArray[np.integer]) -> Array:
    """Learn the likelihood ratio of each number of inliers from pairs of views.

    The two densities are estimated with Poisson kernels: another pair like one of n inliers has a
    number that is Poisson distributed with mean n + ½. Their ratio is made to ascend by pooling
    neighbouring numbers (pool adjacent violators). It is at most one more than the number of pairs,
    and at least the inverse of that: the pairs say no more.

    Args:
        same: (S,) of pairs of views of one place, S ≥ 1.
        other: (O,) of pairs of views of two places, O ≥ 1.

    Returns:
        (L,) the ratios of 0, 1, … inliers, above 0 and never descending. The last one is that of
        more inliers, too.
    """
    numbers = np.arange(2 * int(max(same.max(), other.max())) + 2)
    ours, theirs = (_density(numbers, pairs) for pairs in (same, other))
    most = len(other) + 1.0
    return np.clip(_ascending(ours, theirs), 1 / most, most)


def ratio_of(ratios: Array, inliers: int) -> float:
    """Return the likelihood ratio of this many inliers, from the learned ones (L,)."""
    return float(ratios[min(inliers, len(ratios) - 1)])


def updated(probability: float, ratio: float) -> float:
    """Return the probability after evidence of this likelihood ratio, by Bayes' rule."""
    return probability * ratio / (probability * ratio + 1 - probability)


def _ascending(ours: Array, theirs: Array) -> Array:
    pools: list[tuple[float, float, int]] = []  # mass of both densities, and how many numbers
    for pool in zip(ours.tolist(), theirs.tolist(), [1] * len(ours), strict=True):
        while pools and pools[-1][0] * pool[1] >= pool[0] * pools[-1][1]:
            before = pools.pop()
            pool = before[0] + pool[0], before[1] + pool[1], before[2] + pool[2]
        pools.append(pool)
    return np.concatenate([np.full(count, one / other) for one, other, count in pools])


def _density(numbers: NDArray[np.int64], pairs: NDArray[np.integer]) -> Array:
    means, weights = np.unique(pairs + _CONTINUOUS, return_counts=True)
    factorials = np.cumsum(np.log(np.maximum(numbers, 1)))
    logs = numbers[:, None] * np.log(means) - means - factorials[:, None]
    density: Array = np.exp(logs) @ weights / len(pairs)
    return np.maximum(density, _LEAST)
