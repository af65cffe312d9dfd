"""The motion model against its equations, number by number."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.matching.motion import (
    REACH,
    RESOLVED,
    SPEEDS,
    UNKNOWN,
    evenly_spaced,
    mean_student,
    motion,
    step_lengths,
    step_likelihoods,
)

STATIONARY = 0.04


def likelihoods_of(apart: np.ndarray, step: float) -> np.ndarray:
    made = np.empty((len(SPEEDS), apart.shape[1]), np.float32)
    step_likelihoods(apart.astype(np.float32), STATIONARY, SPEEDS, step, made)
    return made


def student(difference: float) -> float:
    return float((1 + (difference / 0.3) ** 2 / 2) ** -1.5)


def test_speeds_are_from_stationary_to_six_places_a_frame_and_three_that_are_too_fast() -> None:
    assert SPEEDS[0] == 0
    assert 0 < SPEEDS[1] <= 1 / 30
    assert SPEEDS[RESOLVED - 1 :].tolist() == [6, 7, 9, 11]
    assert np.all(np.diff(SPEEDS) > 0)


def test_chances_of_steps_are_those_of_the_documentation() -> None:
    """A step is one of the two nearest whole numbers, averaged over a range of speeds."""
    made = motion()
    assert made.prior.sum() == pytest.approx(1)
    np.testing.assert_allclose(made.chances.sum(axis=1), 1, rtol=1e-6)
    np.testing.assert_allclose(made.chances @ np.arange(REACH + 1), SPEEDS, atol=1e-6)
    by_speed = dict(zip(SPEEDS.tolist(), made.chances.tolist(), strict=True))
    assert by_speed[0] == [1, *[0] * REACH]
    assert by_speed[0.25] == pytest.approx([0.75, 0.25, *[0] * 11])
    assert by_speed[1.5] == pytest.approx([0, 0.5, 0.5, *[0] * 10])
    # The mean of max(1 - |s - 1|, 0) for s from 7/8 to 9/8, and for s from 5/2 to 7/2.
    assert by_speed[1] == pytest.approx([1 / 32, 15 / 16, 1 / 32, *[0] * 10], abs=1e-3)
    assert by_speed[3] == pytest.approx([0, 0, 1 / 8, 3 / 4, 1 / 8, *[0] * 8], abs=2e-3)
    assert by_speed[9][8:11] == pytest.approx([1 / 4, 1 / 2, 1 / 4], abs=6e-3)


def test_a_step_takes_one_of_three_numbers_of_places_at_each_speed() -> None:
    """The compiled loops add up three terms."""
    made = motion()
    for chances, least in zip(made.chances, made.least.tolist(), strict=True):
        assert chances[least : least + 3].sum() == chances.sum()
        assert least == 0 or chances[0] == 0


def test_a_stop_lasts_five_frames_and_a_speed_sixty() -> None:
    change = motion().change
    assert change[0] == pytest.approx(1 / 5)
    np.testing.assert_allclose(change[1:], 1 / 60, rtol=1e-6)


@given(
    st.lists(st.floats(0, 1.5), min_size=6, max_size=6),
    st.floats(0, 2),
)
def test_a_step_is_as_likely_as_it_is_near_the_expected_length_at_its_speed(
    apart: list[float], step: float
) -> None:
    made = likelihoods_of(np.array(apart)[:, None], step)[:, 0]
    lengths = [STATIONARY, *(max(length, STATIONARY) for length in apart)]
    for speed, likelihood in zip(SPEEDS.tolist(), made.tolist(), strict=True):
        low = math.floor(speed)
        if speed < 1:
            expected = STATIONARY + (lengths[1] - STATIONARY) * math.sqrt(speed)
        elif speed > 6:  # no more is known than of six places
            expected = lengths[6]
        elif speed == low:
            expected = lengths[low]
        else:
            between = apart[low - 1] + (apart[low] - apart[low - 1]) * (speed - low)
            expected = max(between, STATIONARY)
        assert likelihood == pytest.approx(student(max(step, STATIONARY) - expected), rel=1e-3)


def test_an_unknown_step_is_equally_likely_at_all_speeds() -> None:
    assert np.all(likelihoods_of(np.ones((6, 9)), UNKNOWN) == 1)


def test_a_jump_has_the_mean_likelihood_of_random_pairs() -> None:
    lengths = np.linspace(0, 1.5, 77)
    expected = np.mean([student(0.9 - length) for length in lengths])
    assert mean_student(lengths.astype(np.float32), 0.9) == pytest.approx(expected, rel=1e-5)


def test_the_stationary_step_is_a_twentieth_of_the_median_step() -> None:
    apart = np.tile(np.array([0.1, 0.4, 0.9], np.float32), (6, 1))
    made = step_lengths(apart, np.ones(3, np.float32))
    assert made.typical == pytest.approx(0.4)
    assert made.stationary == pytest.approx(0.02)


def test_where_no_place_is_apart_a_typical_step_is_one() -> None:
    assert step_lengths(np.zeros((6, 4), np.float32), np.zeros(4, np.float32)).typical == 1


@given(st.integers(1, 5000))
def test_a_sample_of_rows_is_evenly_spaced(count: int) -> None:
    some = evenly_spaced(np.arange(count), 250)
    assert 1 <= len(some) <= 250
    assert len(set(np.diff(some).tolist())) <= 1
