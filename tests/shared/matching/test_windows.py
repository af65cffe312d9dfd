from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from windowed import mean_of

from placefield.matching.windows import RecentDistances, WindowSums

Array = NDArray[np.int32]
MOST = (2 * 4015) ** 2
"""The largest squared distance between quantized descriptors."""

scales = st.lists(st.integers(1, 9), min_size=1, max_size=4, unique=True).map(sorted)


def made_up_distances(frames: int, places: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).integers(0, MOST + 1, (frames, places), np.int32)


class Sums:
    """The sums of a stream, of the backward windows, or of the forward windows."""

    def __init__(self, lengths: list[int], places: int, *, forward: bool = False) -> None:
        self.recent = RecentDistances(max(lengths), places)
        self.windows = WindowSums(self.recent, lengths, forward=forward)

    def update(self, distances: Array) -> None:
        self.recent.update(distances, mean_of(distances))
        self.windows.slide()

    def update_missing(self) -> None:
        self.recent.update_missing()
        self.windows.slide()

    def values(self) -> NDArray[np.float64]:
        """By length and by the place at which the window ends, or begins in reverse order."""
        places = [self.windows.column(place) for place in range(self.recent.places)]
        return self.windows.columns[:, places]


def reference_sum(distances: Array, length: int, place: int) -> int:
    """Add up the window of a length that ends at the newest frame and at a place."""
    total = 0
    newest = len(distances) - 1
    for back in range(min(length, newest + 1)):
        row = [int(distance) for distance in distances[newest - back]]
        if place - back >= 0:
            total += row[place - back]
        else:
            total += round(Fraction(sum(row), len(row)))
    return total


@given(scales, st.integers(1, 12), st.integers(1, 60), st.integers(0, 99))
def test_sums_are_those_of_the_reference(
    lengths: list[int], places: int, frames: int, seed: int
) -> None:
    """With young streams, windows that begin before the first place, maps shorter than them, even

    of one place, and streams whose columns have come around several times.
    """
    distances = made_up_distances(frames, places, seed)
    windows = Sums(lengths, places)
    for newest in range(frames):
        windows.update(distances[newest])
        expected = [
            [reference_sum(distances[: newest + 1], length, place) for place in range(places)]
            for length in lengths
        ]
        np.testing.assert_array_equal(windows.values(), expected)
    assert windows.windows.frames == frames


@given(scales, st.integers(1, 12), st.integers(1, 30), st.integers(0, 99))
def test_forward_sums_are_those_of_the_reference(
    lengths: list[int], places: int, frames: int, seed: int
) -> None:
    """Of the frame whose longest window is complete, with the places in reverse order."""
    distances = made_up_distances(frames, places, seed)
    windows = Sums(lengths, places, forward=True)
    for newest in range(frames):
        windows.update(distances[newest])
        begin = newest - max(lengths) + 1
        if begin < 0:
            continue
        expected = [
            [
                sum(
                    int(distances[begin + i, place + i])
                    if place + i < places
                    else mean_of(distances[begin + i])
                    for i in range(length)
                )
                for place in reversed(range(places))
            ]
            for length in lengths
        ]
        np.testing.assert_array_equal(windows.values(), expected)
        assert windows.windows.frames == max(lengths)


def test_sums_stay_exact_in_a_long_stream_of_the_largest_distances() -> None:
    windows = Sums([1, 700], 40)
    for distances in made_up_distances(3000, 40):
        windows.update(distances)
    for _ in range(700):
        windows.update(np.full(40, MOST, np.int32))
    np.testing.assert_array_equal(windows.values(), [[MOST] * 40, [700 * MOST] * 40])


@given(scales, st.integers(1, 12), st.integers(0, 99), st.data())
def test_only_the_frames_in_the_window_count(
    lengths: list[int], places: int, seed: int, data: st.DataObject
) -> None:
    frames = data.draw(st.integers(max(lengths), 40))
    distances = made_up_distances(frames, places, seed)
    whole, last = Sums(lengths, places), Sums(lengths, places)
    for row in distances:
        whole.update(row)
    for row in distances[-max(lengths) :]:
        last.update(row)
    assert whole.values().tobytes() == last.values().tobytes()


@pytest.mark.parametrize("places", [7, 200, 1261])
def test_a_missing_observation_is_as_far_from_everywhere_as_the_last_one_was_on_average(
    places: int,
) -> None:
    distances = made_up_distances(3, places)
    windows, by_hand = Sums([2, 5], places), Sums([2, 5], places)
    for row in distances:
        windows.update(row)
        by_hand.update(row)
    mean = round(Fraction(int(distances[-1].sum(dtype=np.int64)), places))
    for _ in range(4):
        windows.update_missing()
        by_hand.update(np.full(places, mean, np.int32))
        np.testing.assert_array_equal(windows.values(), by_hand.values())
    np.testing.assert_array_equal(windows.values()[0], 2 * mean)


def test_a_stream_begins_with_the_first_observation() -> None:
    distances = made_up_distances(6, 8)
    late, prompt = Sums([3, 4], 8), Sums([3, 4], 8)
    for _ in range(5):
        late.update_missing()
    for row in distances:
        late.update(row)
        prompt.update(row)
        np.testing.assert_array_equal(late.values(), prompt.values())
        assert late.windows.frames == prompt.windows.frames
