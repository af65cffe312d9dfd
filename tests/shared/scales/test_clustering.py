import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from scipy.special import log_softmax

from placefield.errors import ConfigError, MapError
from placefield.scales.clustering import cluster, with_route_position


def route(frames: int = 90, dimensions: int = 12, scale: float = 1.0) -> NDArray[np.float32]:
    """Three stretches of looks, each drifting a little."""
    rng = np.random.default_rng(5)
    looks = np.repeat(rng.normal(size=(3, dimensions)), frames // 3, axis=0)
    drift = np.cumsum(rng.normal(scale=0.1, size=(frames, dimensions)), axis=0)
    return (scale * (looks + drift)).astype(np.float32)


def memberships_in_log_space(
    vectors: NDArray[np.float32], centres: NDArray[np.float32], fuzzifier: float
) -> NDArray[np.float64]:
    """µ_ik ∝ ‖x_i − c_k‖^(−2/(m−1)), normalised where nothing can overflow."""
    logs = np.log(cdist(vectors.astype(float), centres.astype(float)))
    return np.exp(log_softmax(-2 / (fuzzifier - 1) * logs, axis=1))


@pytest.mark.parametrize("fuzzifier", [1.02, 1.1, 1.4, 2.0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_memberships_and_centres_are_a_fixed_point_of_the_updates(
    fuzzifier: float, scale: float
) -> None:
    vectors = route(scale=scale)
    found = cluster(vectors, 6, fuzzifier, seed=0)
    assert np.isfinite(found.memberships).all()
    np.testing.assert_allclose(
        found.memberships,
        memberships_in_log_space(vectors, found.centres, fuzzifier),
        atol=2e-4,
    )
    weights = found.memberships.astype(float) ** fuzzifier
    means = weights.T @ vectors / weights.sum(axis=0)[:, None]
    np.testing.assert_allclose(found.centres, means, atol=0.01 * scale)


def test_a_frame_at_its_centre_belongs_to_it_alone() -> None:
    vectors = np.repeat(np.eye(3, dtype=np.float32), 5, axis=0)
    found = cluster(vectors, 3, 1.02, seed=1)
    assert np.isfinite(found.memberships).all()
    np.testing.assert_allclose(found.memberships.sum(axis=1), 1, atol=1e-6)
    assert len(set(found.labels[::5])) == 3
    assert (found.labels.reshape(3, 5) == found.labels[::5, None]).all()


def test_the_label_is_the_cluster_of_highest_membership() -> None:
    found = cluster(route(), 7, 1.3, seed=0)
    np.testing.assert_array_equal(found.labels, found.memberships.argmax(axis=1))
    assert (found.centres.shape, found.memberships.shape) == ((7, 12), (90, 7))
    assert found.centres.dtype == found.memberships.dtype == np.float32


def test_same_seed_same_clustering_and_the_global_generator_untouched() -> None:
    np.random.seed(1)  # noqa: NPY002
    untouched = np.random.random(3)  # noqa: NPY002
    first = cluster(route(), 8, 1.2, seed=4)
    np.random.seed(1)  # noqa: NPY002
    second = cluster(route(), 8, 1.2, seed=4)
    np.testing.assert_array_equal(first.memberships, second.memberships)
    np.testing.assert_array_equal(np.random.random(3), untouched)  # noqa: NPY002


def test_refuses_what_cannot_be_clustered() -> None:
    with pytest.raises(ConfigError, match=r"fuzzifier 1 .* above 1"):
        cluster(route(), 3, 1.0, seed=0)
    with pytest.raises(MapError, match="90 frames cannot form 91 clusters"):
        cluster(route(), 91, 1.1, seed=0)


def test_every_number_of_clusters_up_to_the_frames_works() -> None:
    for clusters in (1, 2, 29, 30):
        assert cluster(route(30), clusters, 1.1, seed=0).memberships.shape == (30, clusters)


def test_no_weight_leaves_the_vectors_unchanged() -> None:
    vectors = route()
    assert with_route_position(vectors, 0) is vectors


@pytest.mark.parametrize("frames", [60, 900])
def test_position_counts_per_frame_on_routes_of_any_length(frames: int) -> None:
    vectors = np.random.default_rng(0).normal(size=(frames, 40)).astype(np.float32)
    for weight in (0.5, 1.0):
        placed = with_route_position(vectors, weight)
        np.testing.assert_array_equal(placed[:, :-1], vectors)
        among_random_frames = np.sqrt((cdist(vectors, vectors) ** 2).mean())
        twenty_apart = placed[20:, -1] - placed[:-20, -1]
        np.testing.assert_allclose(twenty_apart, weight * among_random_frames, rtol=1e-3)


def test_position_makes_clusters_consecutive() -> None:
    there_and_back = np.vstack([route(), route()[::-1]])
    runs = [
        np.count_nonzero(np.diff(cluster(vectors, 9, 1.1, seed=0).labels)) + 1
        for vectors in (there_and_back, with_route_position(there_and_back, 1.0))
    ]
    assert runs[1] == 9 < runs[0]
