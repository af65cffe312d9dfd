import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.evaluation.reliability import reliability

# Multiples of 1/60 lie on the edges of most bins' counts, where rounding errors would show.
PROBABILITIES = st.one_of(st.floats(0, 1), st.integers(0, 60).map(lambda n: n / 60))
MATCHES = st.lists(st.tuples(PROBABILITIES, st.booleans()), max_size=40)


@given(matches=MATCHES, bins=st.integers(1, 15))
def test_every_bin_is_that_of_a_naive_loop(matches: list[tuple[float, bool]], bins: int) -> None:
    probability = np.array([p for p, _ in matches], np.float64)
    correct = np.array([c for _, c in matches], np.bool_)

    found = reliability(probability, correct, bins)

    error = 0.0
    for b in range(bins):
        inside = [
            (p, c)
            for p, c in matches
            if b / bins <= p and (p < (b + 1) / bins or (b == bins - 1 and p == 1))
        ]
        assert found.count[b] == len(inside)
        if not inside:
            assert math.isnan(found.mean_probability[b])
            assert math.isnan(found.share_correct[b])
            continue
        mean = math.fsum(p for p, _ in inside) / len(inside)
        share = sum(c for _, c in inside) / len(inside)
        assert found.mean_probability[b] == pytest.approx(mean, abs=1e-12)
        assert found.share_correct[b] == pytest.approx(share, abs=1e-12)
        error += len(inside) / len(matches) * abs(share - mean)
    assert found.expected_calibration_error == pytest.approx(error, abs=1e-12)


@pytest.mark.parametrize(
    ("probability", "correct", "error"),
    [
        ([1.0, 1.0], [True, True], 0.0),
        ([1.0, 1.0], [False, False], 1.0),
        ([0.5] * 4, [True, False, True, False], 0.0),
        ([0.9, 0.9, 0.2], [True, True, False], 0.4 / 3),
    ],
)
def test_the_error_of_simple_cases(
    probability: list[float], correct: list[bool], error: float
) -> None:
    found = reliability(np.array(probability), np.array(correct))

    assert found.expected_calibration_error == pytest.approx(error)


@pytest.mark.filterwarnings("error")
def test_no_matches_make_no_error() -> None:
    found = reliability(np.empty(0), np.empty(0, np.bool_))

    assert found.expected_calibration_error == 0
    assert np.isnan(found.share_correct).all()


@pytest.mark.parametrize("probability", [[0.5], [0.5, 1.1], [0.5, -0.1], [0.5, math.nan]])
def test_arguments_that_are_not_a_probability_per_match_are_refused(
    probability: list[float],
) -> None:
    with pytest.raises(ValueError, match="probability"):
        reliability(np.array(probability), np.array([True, False]))


def test_no_bins_are_refused() -> None:
    with pytest.raises(ValueError, match="bins"):
        reliability(np.array([0.5]), np.array([True]), bins=0)
