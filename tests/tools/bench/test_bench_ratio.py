"""The interval of a ratio, beside the order statistics of a textbook and a simulation."""

import math

import numpy as np
import pytest

from placefield_tools.bench.ratio import Ratio


def of(ratios: list[float]) -> Ratio:
    return Ratio.of(np.array(ratios), np.ones(len(ratios)))


def test_the_interval_is_that_of_the_order_statistics() -> None:
    # For 20 values the 6th and the 15th: the binomial distribution has 2.1 % beyond each.
    ratio = of([float(number) for number in range(1, 21)])
    assert (ratio.value, ratio.low, ratio.high) == (10.5, 6, 15)


def test_fewer_than_six_rounds_have_no_interval() -> None:
    few = of([3.0] * 5)
    assert few.value == 3
    assert math.isnan(few.low)
    assert math.isnan(few.high)
    assert not few.is_narrow
    assert of([3.0] * 6).is_narrow


@pytest.mark.parametrize(("high", "is_narrow"), [(2.19, True), (2.22, False)])
def test_narrow_is_less_than_a_tenth_of_the_ratio(high: float, is_narrow: bool) -> None:
    assert of([2.0, 2.1, 2.1, 2.1, 2.1, high]).is_narrow == is_narrow


def test_rounds_are_compared_in_pairs() -> None:
    busy = np.array([1.0, 5.0, 2.0, 9.0, 3.0, 4.0])  # a machine that is now slow, now fast
    ratio = Ratio.of(3 * busy, busy)
    assert (ratio.value, ratio.low, ratio.high) == (3, 3, 3)


def test_nineteen_of_twenty_intervals_hold_the_true_ratio() -> None:
    rng = np.random.default_rng(0)
    found = [of(list(np.exp(rng.normal(size=25)))) for _ in range(400)]
    assert np.mean([ratio.low <= 1 <= ratio.high for ratio in found]) >= 0.94


def test_a_multiple_has_the_multiple_of_the_interval() -> None:
    ratio = of([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).times(10)
    assert (ratio.value, ratio.low, ratio.high) == (35, 10, 60)
