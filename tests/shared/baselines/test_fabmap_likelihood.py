from itertools import product

import numpy as np
import pytest

from placefield.baselines.fabmap import ChowLiuTree, learn_tree
from placefield.baselines.fabmap.likelihood import log_likelihoods

WORDS = 4
CASES = np.array(list(product([False, True], repeat=WORDS)))
DETECTORS = [(0.0, 0.39), (0.05, 0.6)]


@pytest.fixture
def tree() -> ChowLiuTree:
    rng = np.random.default_rng(3)
    return learn_tree((rng.random((30, 1)) < 0.5) ^ (rng.random((30, WORDS)) < 0.3))


def reference_likelihood(
    z: list[int], mapped: list[int], tree: ChowLiuTree, detector: tuple[float, float]
) -> float:
    """Compute p(Z | L) in the form in which the paper prints it, with its α and β."""

    def p_z(q: int, value: int) -> float:
        return float(tree.present[q] if value else 1 - tree.present[q])

    def p_z_given_e(value: int, e: int) -> float:
        return detector[e] if value else 1 - detector[e]

    def p_z_given_parent(q: int, value: int) -> float:
        if tree.parent[q] == q:
            return p_z(q, value)
        present = float(tree.present_given[z[tree.parent[q]], q])
        return present if value else 1 - present

    likelihood = 1.0
    for q in range(WORDS):
        evidence = sum(p_z_given_e(mapped[q], e) * p_z(q, e) for e in (0, 1))
        factor = 0.0
        for e in (0, 1):
            belief = p_z_given_e(mapped[q], e) * p_z(q, e) / evidence
            alpha = p_z(q, z[q]) * p_z_given_e(1 - z[q], e) * p_z_given_parent(q, 1 - z[q])
            beta = p_z(q, 1 - z[q]) * p_z_given_e(z[q], e) * p_z_given_parent(q, z[q])
            factor += belief * beta / (alpha + beta)
        likelihood *= factor
    return likelihood


@pytest.mark.parametrize("detector", DETECTORS)
def test_is_the_printed_equation(tree: ChowLiuTree, detector: tuple[float, float]) -> None:
    reference = [
        [reference_likelihood(z, mapped, tree, detector) for mapped in CASES.astype(int).tolist()]
        for z in CASES.astype(int).tolist()
    ]
    np.testing.assert_allclose(np.exp(log_likelihoods(CASES, CASES, tree, detector)), reference)


@pytest.mark.parametrize("detector", DETECTORS)
def test_all_observations_of_a_place_sum_to_one(
    tree: ChowLiuTree, detector: tuple[float, float]
) -> None:
    likelihoods = np.exp(log_likelihoods(CASES, CASES, tree, detector))
    np.testing.assert_allclose(likelihoods.sum(axis=0), 1)
