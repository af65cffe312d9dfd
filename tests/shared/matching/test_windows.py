from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from windowed import mean_of

from placefield.matching.windows import WindowSums

Array = NDArray[np.int32]
MOST = (2 * 4015) ** 2
"""The largest squared distance between codes."""

scales = st.lists(st.integers(1, 9), min_size=1, max_size=4, unique=True).map(sorted)


def made_up_distances(frames: int, places: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).integers(0, MOST + 1, (frames, places), np.int32)


def push(windows: WindowSums, distances: Array) -> None:
    windows.push(distances, mean_of(distances))


def sums_of(windows: WindowSums) -> NDArray[np.float64]:
    """By length and by the place at which the window ends."""
    places = [windows.column(place) for place in range(windows.places)]
    return windows.columns[:, places]


def literal_sum(distances: Array, length: int, place: int) -> int:
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
def test_sums_are_the_literal_ones(lengths: list[int], places: int, frames: int, seed: int) -> None:
    """With young streams, windows that begin before the first place, maps shorter than them, even

    of one place, and streams whose columns have come around several times.
    """
    distances = made_up_distances(frames, places, seed)
    windows = WindowSums(lengths, places)
    for newest in range(frames):
        push(windows, distances[newest])
        expected = [
            [literal_sum(distances[: newest + 1], length, place) for place in range(places)]
            for length in lengths
        ]
        np.testing.assert_array_equal(sums_of(windows), expected)
    assert windows.frames == frames


def test_sums_stay_exact_in_a_long_stream_of_the_largest_distances() -> None:
    windows = WindowSums([1, 700], 40)
    for distances in made_up_distances(3000, 40):
        push(windows, distances)
    for _ in range(700):
        push(windows, np.full(40, MOST, np.int32))
    np.testing.assert_array_equal(sums_of(windows), [[MOST] * 40, [700 * MOST] * 40])


@given(scales, st.integers(1, 12), st.integers(0, 99), st.data())
def test_only_the_frames_in_the_window_count(
    lengths: list[int], places: int, seed: int, data: st.DataObject
) -> None:
    frames = data.draw(st.integers(max(lengths), 40))
    distances = made_up_distances(frames, places, seed)
    whole, last = WindowSums(lengths, places), WindowSums(lengths, places)
    for row in distances:
        push(whole, row)
    for row in distances[-max(lengths) :]:
        push(last, row)
    assert sums_of(whole).tobytes() == sums_of(last).tobytes()


@pytest.mark.parametrize("places", [7, 200, 1261])
def test_an_unseen_frame_is_as_far_from_everywhere_as_the_last_one_was_on_average(
    places: int,
) -> None:
    distances = made_up_distances(3, places)
    windows, by_hand = WindowSums([2, 5], places), WindowSums([2, 5], places)
    for row in distances:
        push(windows, row)
        push(by_hand, row)
    mean = round(Fraction(int(distances[-1].sum(dtype=np.int64)), places))
    for _ in range(4):
        windows.push_unseen()
        push(by_hand, np.full(places, mean, np.int32))
        np.testing.assert_array_equal(sums_of(windows), sums_of(by_hand))
    np.testing.assert_array_equal(sums_of(windows)[0], 2 * mean)


def test_a_stream_begins_with_the_first_frame_that_was_seen() -> None:
    distances = made_up_distances(6, 8)
    late, prompt = WindowSums([3, 4], 8), WindowSums([3, 4], 8)
    for _ in range(5):
        late.push_unseen()
    for row in distances:
        push(late, row)
        push(prompt, row)
        np.testing.assert_array_equal(sums_of(late), sums_of(prompt))
        assert late.frames == prompt.frames
