import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.baselines.fixed_window import fixed_window, window_sums
from placefield.fusion.match import Match

Array = NDArray[np.float32]


@st.composite
def distances(draw: st.DrawFn) -> Array:
    """Few distinct values, so that sums are exact and ties come."""
    shape = draw(st.integers(1, 12)), draw(st.integers(1, 12))
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    return rng.integers(0, draw(st.sampled_from([2, 1000])), shape).astype(np.float32)


def reference_sum(D: Array, t: int, j: int, length: int, speed: float, lag: int = 0) -> float:
    later = lag if lag < length // 2 else length // 2
    total = 0.0
    for frame in range(t - (length - 1 - later), t + later + 1):
        place = j + round(speed * (frame - t))
        if not (0 <= frame < D.shape[0] and 0 <= place < D.shape[1]):
            return math.inf
        total += float(D[frame, place])
    return total


@given(
    distances(),
    st.integers(1, 8),
    st.sampled_from([0.0, 0.5, 0.8, 1.0, 1.2, 2.0]),
    st.integers(0, 6),
)
def test_sums_are_those_of_every_complete_window(
    D: Array, length: int, speed: float, lag: int
) -> None:
    expected = [
        [reference_sum(D, t, j, length, speed, lag) for j in range(D.shape[1])]
        for t in range(len(D))
    ]
    np.testing.assert_array_equal(window_sums(D, length, speed, lag), expected)


@given(distances(), st.integers(1, 8), st.integers(0, 6))
def test_matches_the_place_of_the_lowest_sum(D: Array, length: int, lag: int) -> None:
    for t, match in enumerate(fixed_window(D, length, lag)):
        sums = [reference_sum(D, t, j, length, 1, lag) for j in range(D.shape[1])]
        if min(sums) == math.inf:
            assert match == Match(-1, 0.0)
        else:
            assert match == Match(sums.index(min(sums)), -min(sums))


@given(distances(), st.integers(1, 8), st.integers(1, 12), st.integers(0, 6))
def test_nothing_after_a_frame_and_its_lag_changes_its_match(
    D: Array, length: int, until: int, lag: int
) -> None:
    smoothed = max(min(until, len(D)) - lag, 0)
    before = fixed_window(D[:until], length, lag)[:smoothed]
    assert before == fixed_window(D, length, lag)[:smoothed]


def test_a_centred_window_answers_in_the_middle_of_the_stream() -> None:
    views = np.random.default_rng(1).normal(size=(30, 8))
    D = np.linalg.norm(views[:, None] - views, axis=2).astype(np.float32)
    places = [match.place for match in fixed_window(D, 9, lag=20)]
    assert places == [-1] * 4 + list(range(4, 26)) + [-1] * 4


@pytest.mark.parametrize("length", [1, 5])
def test_a_traverse_is_recognised_in_itself_from_the_first_complete_window(length: int) -> None:
    views = np.random.default_rng(1).normal(size=(30, 8))
    D = np.linalg.norm(views[10:, None] - views, axis=2).astype(np.float32)
    matches = fixed_window(D, length)
    assert [match.place for match in matches[length - 1 :]] == list(range(9 + length, 30))
    assert {match.place for match in matches[: length - 1]} <= {-1}
