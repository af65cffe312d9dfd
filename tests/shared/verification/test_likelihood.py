"""The likelihood ratio of inliers, and Bayes' rule with it."""

import numpy as np
import pytest
from scipy.stats import poisson

from placefield.verification.likelihood import learn_ratios, ratio_of, updated

RNG = np.random.default_rng(0)
SAME, OTHER = RNG.poisson(16, 100), RNG.poisson(12, 200)


def test_ratios_are_those_of_densities_with_poisson_kernels() -> None:
    numbers = np.arange(8, 25)
    ours, theirs = (
        np.mean([poisson.pmf(numbers, count + 0.5) for count in pairs], axis=0)
        for pairs in (SAME, OTHER)
    )
    ratios = learn_ratios(SAME, OTHER)
    np.testing.assert_allclose(ratios[numbers], ours / theirs, rtol=1e-9)


def test_ratios_never_descend_and_are_no_surer_than_the_pairs_are_many() -> None:
    ratios = learn_ratios(np.full(50, 100), np.full(80, 30))
    assert (np.diff(ratios) >= 0).all()
    assert ratio_of(ratios, 100) == ratio_of(ratios, 10**6) == pytest.approx(81)
    assert ratio_of(ratios, 0) == pytest.approx(1 / 81)


def test_pairs_that_do_not_differ_say_nothing() -> None:
    np.testing.assert_allclose(learn_ratios(np.full(50, 9), np.full(50, 9)), 1)


def test_the_odds_are_multiplied_by_the_ratio() -> None:
    assert updated(0.8, 3) == pytest.approx(12 / 13)
    assert updated(0.0, 100) == 0
    assert updated(1.0, 0.01) == pytest.approx(1)
