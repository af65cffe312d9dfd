"""The likelihood ratio of inliers, and Bayes' rule with it."""

import numpy as np
import pytest
from scipy.stats import geom, poisson

from placefield.verification.likelihood import likelihood_ratios, ratio_of, updated

BY_CHANCE = np.random.default_rng(0).poisson(10, 200)


def test_ratios_are_those_of_a_geometric_density_and_one_with_poisson_kernels() -> None:
    numbers = np.arange(18, 60)
    right = [geom.pmf(numbers, 1 / (1 + mean), loc=-1) for mean in (40, 90)]
    kernels = [poisson.pmf(numbers, count + 0.5) for count in BY_CHANCE]
    chance = (np.sum(kernels, axis=0) + np.mean(right, axis=0)) / 201
    ratios = likelihood_ratios(BY_CHANCE, [40, 90, 40], 99)
    np.testing.assert_allclose(ratios[1, numbers], right[1] / chance, rtol=1e-9)
    np.testing.assert_array_equal(ratios[0], ratios[2])


def test_ratios_never_descend_and_are_no_surer_than_the_pairs_are_many() -> None:
    ratios = likelihood_ratios(np.full(80, 9), [150, 9], 600)
    assert ratios.shape == (2, 601)
    assert (np.diff(ratios) >= 0).all()
    assert 0 < ratios.min() < 0.2
    assert 81 < ratios.max() < 163


def test_more_inliers_than_there_are_ratios_count_as_many() -> None:
    ratios = np.array([0.5, 1, 7])
    assert [ratio_of(ratios, count) for count in (0, 2, 10**6)] == [0.5, 7, 7]


def test_the_odds_are_multiplied_by_the_ratio() -> None:
    assert updated(0.8, 3) == pytest.approx(12 / 13)
    assert updated(0.0, 100) == 0
    assert updated(1.0, 0.01) == pytest.approx(1)
