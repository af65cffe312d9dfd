"""How much likelier a number of inliers is at the right place than by chance."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_CONTINUOUS = 0.5  # added to a count, so that a pair without inliers has a density, too
_LEAST = 1e-150  # of a density, so that ratios of products are finite

Array = NDArray[np.float64]


def likelihood_ratios(by_chance: NDArray[np.integer], means: Sequence[float], most: int) -> Array:
    """Return the likelihood ratio of each number of inliers, for mean numbers at the right place.

    At the right place the number has a geometric distribution: of all with that mean, it has the
    most entropy. By chance its density is estimated with Poisson kernels: another pair like one of
    n inliers has a number that is Poisson distributed with mean n + ½. One more pair may have any
    number that a right one has, because the pairs do not show what is rarer than they are. The
    ratio is made to ascend by pooling neighbouring numbers (pool adjacent violators).

    Args:
        by_chance: (O,) inliers of pairs of views of two places, O ≥ 1.
        means: M numbers of inliers.
        most: inliers, the most that there can be.

    Returns:
        (M, most + 1) the ratios of 0, 1, … inliers, above 0 and never descending in a row.
    """
    numbers, pairs = np.arange(most + 1), len(by_chance)
    right = {mean: _geometric(numbers, mean) for mean in means}
    any_mean = np.mean(list(right.values()), axis=0)
    chance = (pairs * _density(numbers, by_chance) + any_mean) / (pairs + 1)
    ratios = {mean: _ascending(density, chance) for mean, density in right.items()}
    return np.array([ratios[mean] for mean in means])


def ratio_of(ratios: Array, inliers: int) -> float:
    """Return the likelihood ratio of this many inliers, from those of 0, 1, … inliers (L,)."""
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


def _geometric(numbers: NDArray[np.int64], mean: float) -> Array:
    return np.maximum(np.power(mean / (1 + mean), numbers) / (1 + mean), _LEAST)


def _density(numbers: NDArray[np.int64], pairs: NDArray[np.integer]) -> Array:
    means, weights = np.unique(pairs + _CONTINUOUS, return_counts=True)
    factorials = np.cumsum(np.log(np.maximum(numbers, 1)))
    logs = numbers[:, None] * np.log(means) - means - factorials[:, None]
    density: Array = np.exp(logs) @ weights / len(pairs)
    return np.maximum(density, _LEAST)
