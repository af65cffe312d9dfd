from itertools import groupby

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.scales.encoding import encode

clusterings = st.lists(
    st.tuples(st.integers(0, 3), st.integers(1, 12)), min_size=1, max_size=30
).map(lambda runs: np.concatenate([np.full(length, label) for label, length in runs]))


def literal_runs(clusters: NDArray[np.int64]) -> list[tuple[int, int]]:
    runs, first = [], 0
    for _, frames in groupby(clusters.tolist()):
        end = first + len(list(frames))
        runs.append((first, end))
        first = end
    return runs


@given(clusterings, st.integers(1, 8))
def test_encodes_as_the_two_rules_say(clusters: NDArray[np.int64], min_scale: int) -> None:
    labels = [0] * len(clusters)
    active = [(a, b) for a, b in literal_runs(clusters) if b - a >= min_scale]
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
