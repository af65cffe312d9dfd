from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.metrics import auc as sklearn_auc
from sklearn.metrics import precision_recall_curve

from placefield.evaluation.curves import PrecisionRecall, precision_recall


class Answer(NamedTuple):
    correct: bool
    answered: bool
    on_route: bool
    score: float


# Few distinct scores, so that ties are common.
answers = st.lists(
    st.builds(
        lambda on_route, answered, hit, score: Answer(
            on_route and answered and hit, answered, on_route, score / 4
        ),
        st.booleans(),
        st.booleans(),
        st.booleans(),
        st.integers(-4, 4),
    ),
    max_size=30,
)


def sweep(queries: list[Answer]) -> PrecisionRecall:
    columns = np.array(queries, dtype=np.float64).reshape(-1, 4).T
    correct, answered, on_route = columns[:3].astype(bool)
    return precision_recall(correct, answered, on_route, columns[3])


@given(answers)
def test_every_point_is_that_of_counting_at_its_threshold(queries: list[Answer]) -> None:
    curve = sweep(queries)

    on_route = sum(q.on_route for q in queries)
    scores = sorted({q.score for q in queries if q.answered}, reverse=True)
    points = [(float("inf"), 1.0, 0.0)]
    for threshold in scores:
        kept = [q for q in queries if q.answered and q.score >= threshold]
        hits = sum(q.correct for q in kept)
        points.append((threshold, hits / len(kept), hits / on_route if on_route else 0.0))
    area = sum((r1 - r0) * (p0 + p1) / 2 for (_, p0, r0), (_, p1, r1) in pairwise(points))

    assert list(zip(curve.thresholds, curve.precision, curve.recall, strict=True)) == points
    assert curve.auc == pytest.approx(area, abs=1e-12)
    assert curve.recall_at_100_precision == max(r for _, p, r in points if p == 1.0)
    hits = sum(q.correct for q in queries)
    assert curve.recall_at_1 == (hits / on_route if on_route else 0.0)
    assert (curve.queries, curve.on_route) == (len(queries), on_route)


@given(answers)
def test_the_area_is_at_most_the_highest_recall(queries: list[Answer]) -> None:
    curve = sweep(queries)

    assert 0.0 <= curve.recall_at_100_precision <= curve.recall_at_1 <= 1.0
    assert 0.0 <= curve.auc <= curve.recall_at_1 + 1e-12


def everything_answered(
    seed: int,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64]]:
    generator = np.random.default_rng(seed)
    correct = generator.random(400) < 0.6
    score = np.round(generator.normal(correct * 1.0, 1.0), 1)
    return correct, np.ones(400, dtype=bool), score


def test_scikit_learn_agrees_where_all_is_answered_and_on_route() -> None:
    correct, all_true, score = everything_answered(seed=5)

    curve = precision_recall(correct, all_true, all_true, score)

    # scikit-learn divides recall by the correct matches, and sorts the other way round.
    precision, recall, thresholds = precision_recall_curve(correct, score)
    np.testing.assert_allclose(curve.precision, precision[::-1])
    np.testing.assert_allclose(curve.recall, recall[::-1] * correct.mean())
    np.testing.assert_array_equal(curve.thresholds[1:], thresholds[::-1])
    assert curve.auc == pytest.approx(sklearn_auc(recall, precision) * correct.mean())
    assert curve.auc_of_correct == pytest.approx(sklearn_auc(recall, precision))


@pytest.mark.parametrize("seed", range(5))
def test_over_the_correct_matches_scikit_learn_agrees_whatever_was_missed(seed: int) -> None:
    correct, _, score = everything_answered(seed)
    generator = np.random.default_rng(seed)
    answered = generator.random(400) < 0.8
    on_route = correct | (generator.random(400) < 0.7)

    curve = precision_recall(correct & answered, answered, on_route, score)

    precision, recall, _ = precision_recall_curve(correct[answered], score[answered])
    assert curve.auc_of_correct == pytest.approx(sklearn_auc(recall, precision))
    assert curve.recall_at_100_precision_of_correct == pytest.approx(recall[precision == 1].max())


@pytest.mark.parametrize("seed", range(5))
def test_over_the_route_scikit_learn_agrees_where_no_place_was_missed(seed: int) -> None:
    on_route, all_true, score = everything_answered(seed)

    curve = precision_recall(on_route, all_true, on_route, score)

    precision, recall, _ = precision_recall_curve(on_route, score)
    assert curve.auc == pytest.approx(sklearn_auc(recall, precision))
    assert curve.recall_at_100_precision == pytest.approx(recall[precision == 1].max())


@given(st.permutations(range(12)))
def test_the_order_of_the_queries_does_not_matter(order: list[int]) -> None:
    queries = [Answer(i % 3 > 0, True, True, i // 2) for i in range(12)]

    shuffled, sorted_ = sweep([queries[i] for i in order]), sweep(queries)

    np.testing.assert_array_equal(shuffled.precision, sorted_.precision)
    np.testing.assert_array_equal(shuffled.recall, sorted_.recall)


def test_one_confident_answer_off_the_route_takes_all_recall_at_100_precision() -> None:
    right = [Answer(True, True, True, 1.0), Answer(True, True, True, 0.5)]

    assert sweep(right).recall_at_100_precision == 1.0
    assert sweep([*right, Answer(False, True, False, 2.0)]).recall_at_100_precision == 0.0
    assert sweep([*right, Answer(False, False, False, 2.0)]).recall_at_100_precision == 1.0


def test_nothing_on_the_route_gives_zeros() -> None:
    for queries in ([], [Answer(False, True, False, 1.0)]):
        curve = sweep(queries)
        assert (curve.auc, curve.recall_at_100_precision, curve.recall_at_1) == (0.0, 0.0, 0.0)
        assert (curve.auc_of_correct, curve.recall_at_100_precision_of_correct) == (0.0, 0.0)


def test_nan_is_refused_for_an_answer_and_ignored_for_none() -> None:
    with pytest.raises(ValueError, match="NaN"):
        sweep([Answer(True, True, True, float("nan"))])

    assert sweep([Answer(False, False, True, float("nan"))]).recall_at_1 == 0.0


def test_arguments_that_do_not_fit_together_are_refused() -> None:
    with pytest.raises(ValueError, match="off the route"):
        sweep([Answer(True, True, False, 1.0)])
    yes = np.ones(2, dtype=bool)
    with pytest.raises(ValueError, match="same length"):
        precision_recall(yes, yes, yes[:1], np.zeros(2))
