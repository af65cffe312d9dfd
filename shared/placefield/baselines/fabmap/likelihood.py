"""The likelihood of an observation at a place: p(Z | L)."""

import numpy as np
from numpy.typing import NDArray

from placefield.baselines.fabmap.chow_liu import ChowLiuTree


def log_likelihoods(
    observations: NDArray[np.bool_],
    places: NDArray[np.bool_],
    tree: ChowLiuTree,
    detector: tuple[float, float],
) -> NDArray[np.float64]:
    """Compute log p(Z | L) for every observation Z and every place L.

    A place shows element e_q or not; the detector reports word z_q with p(z_q = 1 | e_q). With
    p_q the word's parent in the tree, Cummins and Newman (IJRR 2008) have::

        p(Z | L) = Π_q Σ_e p(z_q | e_q = e, z_p) p(e_q = e | L)
        p(z_q | e_q, z_p) ∝ p(z_q | e_q) p(z_q | z_p) / p(z_q)        summing to 1 over z_q
        p(e_q | L) ∝ p(z_q = what was observed when L was mapped | e_q) p(e_q)

    and, as in openFABMAP, p(e_q = 1) is taken to be p(z_q = 1).

    Args:
        observations: (Q, W) bool.
        places: (K, W) bool, the one observation from which each place is known.
        tree: over the W words.
        detector: p(z = 1 | e = 0) and p(z = 1 | e = 1).

    Returns:
        (Q, K) float64.
    """
    words = np.arange(observations.shape[1])
    factors = np.log(_factors(tree, np.array(detector)))
    z = observations.astype(np.int64)
    z_parent = z[:, tree.parent]
    if_absent, if_present = (factors[z, z_parent, mapped, words] for mapped in (0, 1))
    gain = if_present - if_absent
    total = if_absent.sum(axis=1)[:, None] + gain @ places.T.astype(np.float64)
    return np.asarray(total, np.float64)


def _factors(tree: ChowLiuTree, detector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tabulate p(z_q | z_p, L) by z_q, z_p, the place's own observation of the word, and q."""
    detected = np.stack([1 - detector, detector])  # z, e
    prior = np.stack([1 - tree.present, tree.present])  # z, q; and e, q
    given_parent = np.stack([1 - tree.present_given, tree.present_given])  # z, z_p, q

    reported = detected[:, :, None, None] * (given_parent / prior[:, None])[:, None]
    reported /= reported.sum(axis=0)  # z, e, z_p, q
    given_word = detected[:, :, None] * prior[None]
    given_word /= given_word.sum(axis=1, keepdims=True)  # observed, e, q
    return np.asarray(np.einsum("zepq,leq->zplq", reported, given_word), np.float64)
