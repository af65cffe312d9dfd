import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.matching.candidate import UNANSWERED
from placefield.matching.distances import on_grid
from placefield.matching.evidence import evidence
from placefield.matching.windows import WindowSums


def made_up_distances(frames: int, places: int, seed: int) -> NDArray[np.float32]:
    return on_grid(np.random.default_rng(seed).uniform(0, 4, (frames, places)).astype(np.float32))


def literal_evidence(distances: NDArray[np.float32], lengths: list[int]) -> list[float]:
    """Mean distance in each window, z-normalised over the places, averaged over the lengths."""
    newest, places = len(distances) - 1, distances.shape[1]
    total = [0.0] * places
    for length in lengths:
        means = []
        for place in range(places):
            window = [
                float(distances[newest - back, place - back] if place >= back else row_mean)
                for back, row_mean in enumerate(distances.mean(axis=1)[::-1][:length])
            ]
            means.append(sum(window) / len(window))
        mean = sum(means) / places
        deviation = (sum((value - mean) ** 2 for value in means) / places) ** 0.5
        for place in range(places):
            total[place] += (means[place] - mean) / deviation / len(lengths)
    return total


@given(
    st.lists(st.integers(1, 9), min_size=1, max_size=4, unique=True),
    st.integers(3, 12),
    st.integers(1, 20),
    st.integers(0, 99),
)
def test_evidence_is_the_literal_one(
    lengths: list[int], places: int, frames: int, seed: int
) -> None:
    distances = made_up_distances(frames, places, seed)
    windows = WindowSums(lengths, places)
    for newest in range(frames):
        windows.push(distances[newest])
        candidate = evidence(windows)
        expected = literal_evidence(distances[: newest + 1], lengths)
        np.testing.assert_allclose(candidate.evidence, expected, atol=1e-4)
        assert candidate.evidence.dtype == np.float32
        assert candidate.score == candidate.evidence.min()
        assert candidate.evidence[candidate.place] == candidate.score


@pytest.mark.parametrize("places", [1, 10, 1261])
def test_where_all_places_are_alike_there_is_no_candidate(places: int) -> None:
    windows = WindowSums([2, 3, 7], places)
    for distance in on_grid(np.random.default_rng(0).uniform(0, 4, 20).astype(np.float32)):
        windows.push(np.full(places, distance))
        assert evidence(windows).place == UNANSWERED


def test_before_the_first_frame_that_was_seen_there_is_no_candidate() -> None:
    windows = WindowSums([2, 3], 10)
    for _ in range(5):
        windows.push_unseen()
        assert evidence(windows).place == UNANSWERED
    windows.push(made_up_distances(1, 10, 0)[0])
    assert evidence(windows).place != UNANSWERED


def test_in_darkness_the_longest_window_knows_until_it_is_dark_as_a_whole() -> None:
    windows = WindowSums([3, 9], 1261)
    windows.push(made_up_distances(1, 1261, 0)[0])
    answered = []
    for _ in range(20):
        windows.push_unseen()
        answered.append(evidence(windows).place != UNANSWERED)
    assert answered == [True] * 8 + [False] * 12


def test_a_candidate_stays_what_it_was() -> None:
    distances = made_up_distances(5, 10, 0)
    windows = WindowSums([2, 3], 10)
    windows.push(distances[0])
    candidate = evidence(windows)
    kept = candidate.evidence.copy()
    for row in distances[1:]:
        windows.push(row)
        evidence(windows)
    np.testing.assert_array_equal(candidate.evidence, kept)
