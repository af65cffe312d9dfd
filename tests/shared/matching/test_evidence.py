import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from windowed import Windowed

from placefield.matching.candidate import UNANSWERED
from placefield.matching.evidence import EvidenceMatcher

MOST = (2 * 4015) ** 2
"""The largest squared distance between quantized descriptors."""


def made_up_distances(frames: int, places: int, seed: int) -> NDArray[np.int32]:
    return np.random.default_rng(seed).integers(0, MOST + 1, (frames, places), np.int32)


def reference_evidence(distances: NDArray[np.int32], lengths: list[int]) -> list[float]:
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
def test_evidence_is_that_of_the_reference(
    lengths: list[int], places: int, frames: int, seed: int
) -> None:
    distances = made_up_distances(frames, places, seed)
    windows = Windowed(EvidenceMatcher, lengths, places)
    for newest in range(frames):
        candidate = windows.update(distances[newest])
        expected = reference_evidence(distances[: newest + 1], lengths)
        np.testing.assert_allclose(candidate.evidence, expected, atol=1e-4)
        assert candidate.evidence.dtype == np.float32
        assert np.float32(candidate.score) == candidate.evidence.min()
        assert candidate.evidence[candidate.place] == candidate.evidence.min()
        assert len(candidate.places) == 0


@pytest.mark.parametrize("places", [2, 17, 200, 1261])
def test_wherever_the_windows_have_come_to_the_evidence_has_the_same_bits(places: int) -> None:
    """A worker that starts anew with the frames of its longest window goes on as before."""
    distances = made_up_distances(60, places, seed=0)
    old = Windowed(EvidenceMatcher, [3, 5, 9], places)
    for newest in range(60):
        one = old.update(distances[newest])
        new = Windowed(EvidenceMatcher, [3, 5, 9], places)
        for row in distances[max(newest - 8, 0) : newest + 1]:
            other = new.update(row)
        assert (one.place, one.score) == (other.place, other.score)
        assert one.evidence.tobytes() == other.evidence.tobytes()


@pytest.mark.parametrize("places", [1, 10, 1261])
def test_where_all_places_are_alike_there_is_no_candidate(places: int) -> None:
    windows = Windowed(EvidenceMatcher, [2, 3, 7], places)
    for distance in made_up_distances(1, 20, 0)[0]:
        assert windows.update(np.full(places, distance)).place == UNANSWERED


def test_before_the_first_observation_there_is_no_candidate() -> None:
    windows = Windowed(EvidenceMatcher, [2, 3], 10)
    for _ in range(5):
        assert windows.update_missing().place == UNANSWERED
    assert windows.update(made_up_distances(1, 10, 0)[0]).place != UNANSWERED


def test_in_darkness_the_longest_window_knows_until_it_is_dark_as_a_whole() -> None:
    windows = Windowed(EvidenceMatcher, [3, 9], 1261)
    windows.update(made_up_distances(1, 1261, 0)[0])
    answered = []
    for _ in range(20):
        answered.append(windows.update_missing().place != UNANSWERED)
    assert answered == [True] * 8 + [False] * 12


def test_a_candidate_stays_what_it_was() -> None:
    distances = made_up_distances(5, 10, 0)
    windows = Windowed(EvidenceMatcher, [2, 3], 10)
    candidate = windows.update(distances[0])
    kept = candidate.evidence.copy()
    for row in distances[1:]:
        windows.update(row)
    np.testing.assert_array_equal(candidate.evidence, kept)
