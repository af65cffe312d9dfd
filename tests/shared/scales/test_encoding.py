from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.scales.encoding import encode, smallest_scale

clusterings = st.lists(
    st.tuples(st.integers(0, 3), st.integers(1, 12)), min_size=1, max_size=30
).map(lambda runs: np.concatenate([np.full(length, label) for label, length in runs]))


def reference_runs(clusters: NDArray[np.int64]) -> list[tuple[int, int]]:
    runs, first = [], 0
    for _, frames in groupby(clusters.tolist()):
        end = first + len(list(frames))
        runs.append((first, end))
        first = end
    return runs


@given(clusterings, st.integers(1, 8))
def test_encodes_as_the_two_rules_say(clusters: NDArray[np.int64], min_scale: int) -> None:
    labels = [0] * len(clusters)
    active = [(a, b) for a, b in reference_runs(clusters) if b - a >= min_scale]
    for number, (first, end) in enumerate(active, start=1):
        labels[first:end] = [number] * (end - first)

    encoding = encode(clusters, min_scale)

    assert encoding.labels.tolist() == labels
    assert encoding.segments.tolist() == [list(run) for run in active]
    assert encoding.segments.shape == (len(active), 2)
    assert encoding.scales.tolist() == sorted({b - a for a, b in active})
    assert encoding.active == sum(b - a for a, b in active) / len(clusters)
    for array in (encoding.labels, encoding.segments, encoding.scales):
        assert array.dtype == np.int32


@given(clusterings, st.integers(1, 8), st.floats(0.01, 10), st.floats(0, 1e4))
def test_metres_at_constant_speed_are_frames(
    clusters: NDArray[np.int64], min_scale: int, spacing: float, start: float
) -> None:
    travelled = start + spacing * np.arange(len(clusters))
    in_frames = encode(clusters, min_scale)
    if len(clusters) > 1:
        in_metres = encode(clusters, np.floor(1000 * min_scale * spacing) / 1000, travelled)
        np.testing.assert_array_equal(in_metres.labels, in_frames.labels)


def test_a_standstill_is_long_in_frames_and_short_in_metres() -> None:
    clusters = np.repeat([0, 1, 2], 10)
    travelled = np.concatenate([np.arange(10), np.full(10, 9.0), np.arange(10, 20)])
    assert encode(clusters, 5).active == 1
    assert encode(clusters, 5, travelled).segments.tolist() == [[0, 10], [20, 30]]


@given(st.integers(2, 50))
def test_the_smallest_scale_in_frames_is_the_given_one(min_scale: int) -> None:
    assert smallest_scale(min_scale) == min_scale


@given(st.integers(1, 5000), st.integers(1, 20_000), st.integers(2, 60), st.floats(0, 1e5))
def test_the_smallest_scale_in_metres_is_the_fewest_frames_that_reach_it(
    spacing_mm: int, min_scale_mm: int, frames: int, start: float
) -> None:
    travelled = start + spacing_mm / 1000 * np.arange(frames)
    smallest = smallest_scale(min_scale_mm / 1000, travelled)
    fewest = next(n for n in range(1, frames + 1) if n * spacing_mm >= min_scale_mm or n == frames)
    assert smallest == fewest


@given(st.integers(1, 5000), st.integers(1, 8), st.integers(20, 60))
def test_at_constant_speed_the_smallest_scale_is_the_shortest_that_is_active(
    spacing_mm: int, scale: int, frames: int
) -> None:
    travelled = spacing_mm / 1000 * np.arange(frames)
    limit = scale * spacing_mm / 1000
    smallest = smallest_scale(limit, travelled)
    assert smallest == scale
    for length in (scale, scale - 1):
        clusters = np.r_[np.ones(length), np.zeros(frames - length)]
        encoding = encode(clusters, limit, travelled)
        assert (smallest in encoding.scales) == (length == scale)


def test_at_varying_speed_the_smallest_scale_is_by_the_mean_spacing() -> None:
    travelled = np.r_[np.linspace(0, 1, 11), np.linspace(4, 37, 12)]  # 37 m in 22 steps
    assert smallest_scale(37 / 22, travelled) == 1
    assert smallest_scale(37 / 22 + 0.001, travelled) == 2
    assert smallest_scale(10, travelled) == 6


@pytest.mark.parametrize(
    ("min_scale", "travelled", "smallest"),
    [
        (2.0, [0.0] * 9, 9),  # it stands: no number of frames reaches it
        (2.0, [5.0], 1),
        (0.001, [0.0, 1.0, 2.0], 1),
        (1.0, [0.0, 1.0, 2.0], 1),
        (100.0, [0.0, 1.0, 2.0], 3),  # the route is shorter
        (0.3, list(np.arange(20) * 0.1), 3),  # 0.1 has no exact binary value
        (0.7, list(np.arange(20) * 0.1), 7),
    ],
)
def test_the_smallest_scale_is_at_least_a_frame_and_no_more_than_there_are(
    min_scale: float, travelled: list[float], smallest: int
) -> None:
    assert smallest_scale(min_scale, np.array(travelled)) == smallest
    assert smallest_scale(min_scale, np.array(travelled, np.float32)) == smallest
