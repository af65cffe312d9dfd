"""The model of the inliers along a drive, against the textbook's matrices."""

from collections.abc import Sequence
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.matching import motion
from placefield.verification.inlier_model import STATES, InlierModel, ratio_of_posterior
from placefield.verification.likelihood import likelihood_ratios

MOST = 400
BY_CHANCE = np.random.default_rng(0).integers(8, 12, 150)
CONDITIONS = list(product((4, 8, 16, 32, 64), (1 / 64, 1 / 16, 1 / 4, 15 / 16), (1, 4, 16, 64)))
LOSE, RIGHT_AGAIN, CHANGE = 0.003, 0.05, 0.001
WRONG = LOSE / (LOSE + RIGHT_AGAIN)

Array = NDArray[np.float64]


def ratios_along(inliers: Sequence[int]) -> list[float]:
    model, posterior, ratios = InlierModel(BY_CHANCE, MOST), None, []
    for count in inliers:
        posterior = model.update(model.predict(posterior, 1), count)
        ratios.append(ratio_of_posterior(posterior))
    return ratios


def transition() -> Array:
    """Between all conditions and states, (3 C, 3 C): found, missed and wrong of each condition."""
    count = len(CONDITIONS)
    chances = np.zeros((count, 3, count, 3))
    for (one, (_, _, lasts)), (other, (_, missing, _)) in product(
        enumerate(CONDITIONS), enumerate(CONDITIONS)
    ):
        drawn = np.array([1 - missing, missing])
        if one == other:
            for before, after in product((0, 1), (0, 1)):
                stays = (1 - 1 / lasts) * (before == after) + drawn[after] / lasts
                chances[one, before, one, after] += (1 - CHANGE) * (1 - LOSE) * stays
            chances[one, :2, one, 2] += (1 - CHANGE) * LOSE
            chances[one, 2, one, :2] += (1 - CHANGE) * RIGHT_AGAIN * drawn
            chances[one, 2, one, 2] += (1 - CHANGE) * (1 - RIGHT_AGAIN)
        anew = CHANGE / count
        chances[one, :2, other, :2] += anew * (1 - LOSE) * drawn
        chances[one, :2, other, 2] += anew * LOSE
        chances[one, 2, other, :2] += anew * RIGHT_AGAIN * drawn
        chances[one, 2, other, 2] += anew * (1 - RIGHT_AGAIN)
    return chances.reshape(3 * count, 3 * count)


def likelihood(inliers: int) -> Array:
    fractions = [fraction for fraction, _, _ in CONDITIONS]
    ratios = likelihood_ratios(BY_CHANCE, [MOST / each for each in fractions], MOST)
    return np.column_stack([ratios[:, inliers], np.ones((len(fractions), 2))]).ravel()


def start() -> Array:
    states = [
        [(1 - WRONG) * (1 - missing), (1 - WRONG) * missing, WRONG] for _, missing, _ in CONDITIONS
    ]
    return np.ravel(states) / len(CONDITIONS)


def ratio_in(beliefs: Array) -> float:
    wrong = beliefs[2::3].sum() / beliefs.sum()
    return float((1 - wrong) / wrong * WRONG / (1 - WRONG))


def test_it_is_the_forward_algorithm_whatever_frames_are_missing() -> None:
    model, posterior, chances = InlierModel(BY_CHANCE, MOST), None, transition()
    beliefs, last = start(), 2
    for frame, inliers in ((3, 60), (4, 45), (5, 8), (9, 9), (10, 70), (90, 11), (91, 9)):
        beliefs = beliefs @ np.linalg.matrix_power(chances, frame - last) * likelihood(inliers)
        posterior = model.update(model.predict(posterior, frame - last), inliers)
        last = frame
        np.testing.assert_allclose(posterior, beliefs / beliefs.sum(), rtol=1e-9)
        assert ratio_of_posterior(posterior) == pytest.approx(ratio_in(beliefs))


def test_a_posterior_has_all_states_and_a_ratio_even_if_it_came_with_a_message() -> None:
    model = InlierModel(BY_CHANCE, MOST)
    assert len(model.predict(None, 1)) == STATES
    for state in range(STATES):  # any message that is certain of one state
        for inliers in (0, 10**6):
            after = model.update(model.predict(np.eye(STATES)[state], 1), inliers)
            assert after.sum() == pytest.approx(1)
            assert 1e-6 < ratio_of_posterior(after) < 1e6


def test_a_match_is_lost_as_often_as_the_filter_loses_a_vehicle() -> None:
    assert LOSE == motion.LOSE


def test_few_inliers_speak_against_a_match_only_after_many_inliers_before() -> None:
    by_day, by_night = [80, 60, 110, 90] * 10, [9, 8, 10, 9] * 75
    off_the_route = ratios_along([*by_day, *[9] * 30])[40:]
    assert 0.3 < off_the_route[0] < 10  # one frame may be blurred
    assert max(off_the_route[4:]) < 0.12
    assert min(ratios_along(by_night)) > 0.4
    assert ratios_along(by_night)[-1] > 0.9
    assert min(ratios_along(by_day)) > 20


def test_light_that_changes_on_the_way_is_learned_again() -> None:
    ratios = ratios_along([90] * 500 + [9] * 300)
    assert min(ratios) < 0.1
    assert ratios[-1] > 0.8
