import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.baselines.fabmap import ChowLiuTree, FabMap, fabmap, learn_tree
from placefield.baselines.fabmap.likelihood import log_likelihoods
from placefield.baselines.fabmap.posterior import log_posterior
from placefield.matching.candidate import UNANSWERED

PLACES, WORDS = 40, 200
SETTINGS = FabMap(samples=200)


@pytest.fixture(scope="module")
def reference() -> NDArray[np.bool_]:
    return np.random.default_rng(0).random((PLACES, WORDS)) < 0.15


@pytest.fixture(scope="module")
def query(reference: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The reference with one word in ten missed; then a frame without words, and a new place."""
    rng = np.random.default_rng(1)
    again = reference & (rng.random(reference.shape) < 0.9)
    return np.vstack([again, np.zeros((1, WORDS), np.bool_), rng.random((1, WORDS)) < 0.15])


@pytest.fixture(scope="module")
def tree(reference: NDArray[np.bool_]) -> ChowLiuTree:
    return learn_tree(reference)


def test_is_bayes_rule_and_sums_to_one(
    reference: NDArray[np.bool_], query: NDArray[np.bool_], tree: ChowLiuTree
) -> None:
    posterior = np.exp(log_posterior(reference, query, tree, SETTINGS, seed=5))
    np.testing.assert_allclose(posterior.sum(axis=1), 1)

    shown, drawn = query[7:8], tree.sample(200, seed=5)
    known = np.exp(log_likelihoods(shown, reference, tree, (0.0, 0.39)))[0] * 0.1 / PLACES
    new = np.exp(log_likelihoods(shown, drawn, tree, (0.0, 0.39))).mean() * 0.9
    np.testing.assert_allclose(posterior[7], np.append(known, new) / (known.sum() + new))


def test_a_frame_without_words_is_unanswered_and_leaves_the_prior(
    reference: NDArray[np.bool_], query: NDArray[np.bool_], tree: ChowLiuTree
) -> None:
    posterior = np.exp(log_posterior(reference, query, tree, SETTINGS, seed=0))[PLACES]
    np.testing.assert_allclose(posterior, [0.1 / PLACES] * PLACES + [0.9])
    assert fabmap(reference, query, tree, SETTINGS)[PLACES].place == UNANSWERED


def test_knows_places_again_and_doubts_a_new_one(
    reference: NDArray[np.bool_], query: NDArray[np.bool_], tree: ChowLiuTree
) -> None:
    *again, _, new = fabmap(reference, query, tree, SETTINGS)
    assert [match.place for match in again] == list(range(PLACES))
    assert min(match.score for match in again) > 0 > new.score


def test_the_score_is_the_log_odds_also_where_the_probability_rounds_to_one(
    reference: NDArray[np.bool_], query: NDArray[np.bool_], tree: ChowLiuTree
) -> None:
    posterior = np.exp(log_posterior(reference, query, tree, SETTINGS, seed=0))[-1]
    best = posterior[:-1].max()
    new = fabmap(reference, query, tree, SETTINGS)[-1]
    assert new.score == pytest.approx(np.log(best / (1 - best)))

    sure = FabMap(new_place=1e-30, samples=200)
    scores = [match.score for match in fabmap(reference[:2], reference[:2], tree, sure)]
    assert 40 < min(scores) < max(scores) < np.inf  # 1 - exp(-40) is 1


def test_each_frame_is_answered_by_itself(
    reference: NDArray[np.bool_], query: NDArray[np.bool_], tree: ChowLiuTree
) -> None:
    (alone,) = fabmap(reference, query[9:10], tree)
    among_others = fabmap(reference, query, tree)[9]
    assert alone.place == among_others.place
    assert alone.score == pytest.approx(among_others.score)
