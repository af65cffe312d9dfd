from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.metric.rank import reduce_rank


def distance_between_segments(projection, descriptors, labels):
    """Sum the squared distances of all pairs of frames of different segments, one by one."""
    points = descriptors.astype(np.float64) @ projection.T.astype(np.float64)
    return sum(
        ((points[i] - points[j]) ** 2).sum()
        for i, j in combinations(range(len(points)), 2)
        if labels[i] != labels[j]
    )


@given(seed=st.integers(0, 2**32 - 1), kept=st.floats(0.5, 0.999), segments=st.integers(2, 8))
def test_the_fewest_axes_keep_the_asked_part_of_the_distances_between_segments(
    seed, kept, segments
):
    rng = np.random.default_rng(seed)
    spread = rng.uniform(0.1, 3, size=9)
    descriptors = np.float32(rng.normal(size=(30, 9)) * spread + 5)
    labels = np.concatenate([np.arange(segments), rng.integers(segments, size=30 - segments)])
    projection = rng.normal(size=(9, 9)).astype(np.float32)
    whole = distance_between_segments(projection, descriptors, labels)

    reduced = reduce_rank(projection, descriptors, labels, kept)
    part = distance_between_segments(reduced, descriptors, labels) / whole
    without_last = distance_between_segments(reduced[:-1], descriptors, labels) / whole
    assert reduced.dtype == np.float32
    assert part >= kept - 1e-5
    assert without_last < kept + 1e-5


@pytest.mark.parametrize("kept", [1, 0.5])
def test_all_of_the_distances_or_one_segment_leave_the_projection_as_it_is(kept):
    descriptors = np.random.default_rng(0).normal(size=(20, 5)).astype(np.float32)
    labels = np.arange(20) if kept == 1 else np.zeros(20, int)
    projection = np.float32(2 * np.eye(5))
    np.testing.assert_array_equal(reduce_rank(projection, descriptors, labels, kept), projection)
