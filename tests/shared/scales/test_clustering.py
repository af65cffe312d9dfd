import tracemalloc
from typing import Any

import numpy as np
import pytest
import skfuzzy
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from scipy.special import log_softmax

from placefield.errors import ConfigError, MapError
from placefield.metric.squared_distances import squared_distances
from placefield.scales import block_clustering, clustering
from placefield.scales.clustering import cluster
from placefield.scales.placed import Placed, with_route_position


def route(frames: int = 90, dimensions: int = 12, scale: float = 1.0) -> NDArray[np.float32]:
    """Three stretches of views, each drifting a little."""
    rng = np.random.default_rng(5)
    views = np.repeat(rng.normal(size=(3, dimensions)), frames // 3, axis=0)
    drift = np.cumsum(rng.normal(scale=0.1, size=(frames, dimensions)), axis=0)
    return (scale * (views + drift)).astype(np.float32)


def placed(frames: int = 90, dimensions: int = 12, weight: float = 0.0) -> Placed:
    return with_route_position(route(frames, dimensions), weight)


def exact(centres: Placed) -> NDArray[np.float64]:
    """Return centres as skfuzzy does, with their positions if these count."""
    moved = centres.positions.any()
    return np.column_stack([centres.vectors, centres.positions] if moved else [centres.vectors])


def powers_in_log_space(
    vectors: NDArray[np.float64], centres: NDArray[np.float64], fuzzifier: float
) -> NDArray[np.float64]:
    """µ_ik^m with µ_ik ∝ ‖x_i − c_k‖^(−2/(m−1)), normalised where nothing can overflow."""
    logs = np.log(cdist(vectors, centres))
    return np.exp(fuzzifier * log_softmax(-2 / (fuzzifier - 1) * logs, axis=1))


@pytest.fixture(params=[7, 512, None], ids=["many blocks", "one block", "all at once"])
def block(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param is not None:
        monkeypatch.setattr(clustering, "_MOST_MEMBERSHIPS", 0)
        monkeypatch.setattr(block_clustering, "_BLOCK", request.param)


@pytest.mark.usefixtures("block")
@pytest.mark.parametrize("fuzzifier", [1.02, 1.1, 1.4, 2.0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_centres_are_a_fixed_point_of_the_updates(
    fuzzifier: float, scale: float, weight: float
) -> None:
    frames = with_route_position(route(scale=scale), weight)
    found = cluster(frames, 6, fuzzifier, seed=0)
    vectors, centres = frames.exact(), exact(found.centres)
    weights = powers_in_log_space(vectors, centres, fuzzifier)
    means = weights.T @ vectors / weights.sum(axis=0)[:, None]
    np.testing.assert_allclose(centres, means, atol=0.01 * scale)


@pytest.mark.usefixtures("block")
@pytest.mark.parametrize("fuzzifier", [1.02, 1.1, 1.2])
@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_labels_and_centres_are_those_of_scikit_fuzzy(fuzzifier: float, weight: float) -> None:
    frames = placed(weight=weight)
    found = cluster(frames, 6, fuzzifier, seed=3)
    ends = np.sort(np.random.default_rng(3).choice(np.arange(1, 90), 5, replace=False))
    starts = np.eye(6)[:, np.searchsorted(ends, np.arange(90), side="right")]
    centres, memberships, *_ = skfuzzy.cmeans(
        frames.exact().T, 6, fuzzifier, error=1e-3, maxiter=100, init=starts
    )
    np.testing.assert_array_equal(found.labels, memberships.argmax(axis=0))
    np.testing.assert_allclose(exact(found.centres), centres, atol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("fuzzifier", [1.02, 1.2, 1.4])
@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_in_blocks_or_at_once_the_labels_are_equal(
    fuzzifier: float, weight: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = placed(900, 40, weight)
    reported: list[int] = []
    at_once = cluster(frames, 60, fuzzifier, 0, lambda done, total: reported.append(done))
    monkeypatch.setattr(clustering, "_MOST_MEMBERSHIPS", 0)
    in_blocks = cluster(frames, 60, fuzzifier, 0, lambda done, total: reported.append(-done))
    np.testing.assert_array_equal(at_once.labels, in_blocks.labels)
    assert reported[: len(reported) // 2] == [-done for done in reported[len(reported) // 2 :]]


def test_a_frame_at_its_centre_belongs_to_it_alone() -> None:
    vectors = np.repeat(np.eye(3, dtype=np.float32), 5, axis=0)
    found = cluster(with_route_position(vectors, 0), 3, 1.02, seed=1)
    assert np.isfinite(found.centres.vectors).all()
    assert len(set(found.labels[::5])) == 3
    assert (found.labels.reshape(3, 5) == found.labels[::5, None]).all()


def test_the_label_is_the_cluster_of_the_nearest_centre() -> None:
    found = cluster(placed(), 7, 1.3, seed=0)
    assert found.centres.vectors.shape == (7, 12)
    nearest = cdist(route(), found.centres.vectors).argmin(axis=1)
    np.testing.assert_array_equal(found.labels, nearest)
    assert found.labels.dtype == np.int32


def test_same_seed_same_clustering_and_the_global_generator_untouched() -> None:
    np.random.seed(1)  # noqa: NPY002
    untouched = np.random.random(3)  # noqa: NPY002
    first = cluster(placed(), 8, 1.2, seed=4)
    np.random.seed(1)  # noqa: NPY002
    second = cluster(placed(), 8, 1.2, seed=4)
    np.testing.assert_array_equal(first.centres.vectors, second.centres.vectors)
    np.testing.assert_array_equal(np.random.random(3), untouched)  # noqa: NPY002


def test_every_sweep_is_reported_and_may_end_the_clustering() -> None:
    reported: list[int] = []
    cluster(placed(), 6, 1.1, 0, lambda done, total: reported.append(done))
    assert reported == [*range(1, len(reported) + 1)]

    def end(done: int, total: int) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        cluster(placed(), 6, 1.1, 0, end)


def test_memory_does_not_grow_with_frames_times_clusters_where_these_are_many(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def end_after_two(done: int, total: int) -> None:
        if done == 2:
            raise InterruptedError

    monkeypatch.setattr(clustering, "_MOST_MEMBERSHIPS", 6000 * 600 - 1)
    frames = placed(6000)
    cluster(placed(99), 9, 1.1, seed=0)
    tracemalloc.start()
    with pytest.raises(InterruptedError):
        cluster(frames, 600, 1.1, 0, end_after_two)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 6000 * 600 * 8


def test_frames_that_cannot_be_clustered_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"fuzzifier 1 .* above 1"):
        cluster(placed(), 3, 1.0, seed=0)
    with pytest.raises(MapError, match="90 frames cannot form 91 clusters"):
        cluster(placed(), 91, 1.1, seed=0)


def test_every_number_of_clusters_up_to_the_frames_works() -> None:
    for clusters in (1, 2, 29, 30):
        centres = cluster(placed(30), clusters, 1.1, seed=0).centres
        assert len(centres.vectors) == clusters


def test_position_makes_clusters_consecutive() -> None:
    there_and_back = np.vstack([route(), route()[::-1]])
    both = [with_route_position(there_and_back, weight) for weight in (0.0, 1.0)]
    runs = [
        np.count_nonzero(np.diff(cluster(frames, 9, 1.1, seed=0).labels)) + 1 for frames in both
    ]
    assert runs[1] == 9 < runs[0]


@pytest.mark.parametrize("fuzzifier", [1.02, 1.4])
def test_of_a_long_route_only_the_clusters_near_a_frame_are_compared_with_it(
    fuzzifier: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared: list[int] = []

    def counting(rows: NDArray[Any], columns: NDArray[Any]) -> NDArray[Any]:
        compared.append(len(rows) * len(columns))
        return squared_distances(rows, columns)

    vectors = np.random.default_rng(2).normal(size=(500, 40)).repeat(4, axis=0)
    frames = with_route_position(vectors.astype(np.float32), 1.0)
    at_once = cluster(frames, 160, fuzzifier, 0).labels
    monkeypatch.setattr(clustering, "_MOST_MEMBERSHIPS", 0)
    monkeypatch.setattr(block_clustering, "squared_distances", counting)
    sweeps: list[int] = []
    in_blocks = cluster(frames, 160, fuzzifier, 0, lambda done, total: sweeps.append(done))
    np.testing.assert_array_equal(in_blocks.labels, at_once)
    assert sum(compared) < 0.5 * len(sweeps) * 2000 * 160
