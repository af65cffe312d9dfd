"""The Chow-Liu tree over a vocabulary: which words appear together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

# Frames that are added to each of a pair's four cases, so that nothing is impossible.
_PSEUDO_COUNT = 0.5


@dataclass(frozen=True, eq=False)
class ChowLiuTree:
    """A joint distribution of W binary words in which each depends on one other, its parent.

    Attributes:
        order: (W,) int64, the words, each behind its parent; the first is the root.
        parent: (W,) int64, each word's parent; the root is its own.
        present: (W,) float64, p(z = 1).
        present_given: (2, W) float64, p(z = 1 | parent's z = 0) and p(z = 1 | parent's z = 1);
            for the root both are p(z = 1).
    """

    order: NDArray[np.int64]
    parent: NDArray[np.int64]
    present: NDArray[np.float64]
    present_given: NDArray[np.float64]

    def sample(self, count: int, seed: int) -> NDArray[np.bool_]:
        """Draw observations from the joint distribution, (count, W) bool."""
        chance = np.random.default_rng(seed).random((count, len(self.order)))
        observations = np.zeros(chance.shape, np.bool_)
        for word in self.order:
            parent = observations[:, self.parent[word]].astype(np.int64)
            observations[:, word] = chance[:, word] < self.present_given[parent, word]
        return observations


def learn_tree(observations: NDArray[np.bool_]) -> ChowLiuTree:
    """Learn the tree whose joint distribution is closest to that of the observations.

    It is the spanning tree of highest total mutual information between neighbours (Chow and Liu,
    1968). All probabilities are relative frequencies with half a frame added to each of a pair's
    four cases. FAB-MAP's lower bound on the mutual information of a pair, which saves memory in
    large vocabularies, is left out.

    Args:
        observations: (K, W) bool, which words each of K frames has; W at least 1.
    """
    frames = len(observations) + 4 * _PSEUDO_COUNT
    shown = observations.astype(np.float64)
    both = (shown.T @ shown + _PSEUDO_COUNT) / frames
    present = (shown.sum(axis=0) + 2 * _PSEUDO_COUNT) / frames
    # Every spanning tree has W - 1 branches: the shift changes no choice among them, and keeps
    # pairs without information from reading as pairs that must not be joined.
    branches = minimum_spanning_tree(-1 - _mutual_information(both, present))
    order, parent = breadth_first_order(branches, 0, directed=False)
    parent[0] = 0

    with_parent, of_parent = both[np.arange(len(parent)), parent], present[parent]
    given = np.stack([(present - with_parent) / (1 - of_parent), with_parent / of_parent])
    given[:, 0] = present[0]
    return ChowLiuTree(order.astype(np.int64), parent.astype(np.int64), present, given)


def _mutual_information(
    both: NDArray[np.float64], present: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the mutual information of every pair of words in nats, (W, W).

    Args:
        both: (W, W), p(z_i = 1, z_j = 1).
        present: (W,), p(z = 1).
    """
    one, other = present[:, None], present[None, :]
    cases = (
        (both, one * other),
        (one - both, one * (1 - other)),
        (other - both, (1 - one) * other),
        (1 - one - other + both, (1 - one) * (1 - other)),
    )
    information = [joint * np.log(joint / apart) for joint, apart in cases]
    return np.asarray(np.sum(information, axis=0), np.float64)
