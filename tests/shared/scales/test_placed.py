import numpy as np
import pytest
from scipy.spatial.distance import cdist

from placefield.scales.placed import with_route_position


def test_no_weight_leaves_all_frames_at_one_position() -> None:
    vectors = np.random.default_rng(0).normal(size=(60, 40)).astype(np.float32)
    frames = with_route_position(vectors, 0)
    assert frames.vectors is vectors
    assert not frames.positions.any()
    np.testing.assert_array_equal(frames.exact(), vectors)


@pytest.mark.parametrize("frames", [60, 900])
def test_position_counts_per_frame_on_routes_of_any_length(frames: int) -> None:
    vectors = np.random.default_rng(0).normal(size=(frames, 40)).astype(np.float32)
    for weight in (0.5, 1.0):
        exact = with_route_position(vectors, weight).exact()
        np.testing.assert_array_equal(exact[:, :-1], vectors)
        among_random_frames = np.sqrt((cdist(vectors, vectors) ** 2).mean())
        twenty_apart = exact[20:, -1] - exact[:-20, -1]
        np.testing.assert_allclose(twenty_apart, weight * among_random_frames, rtol=1e-3)
