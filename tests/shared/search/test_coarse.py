"""The coarse search of all places, and the re-ranking of the nearest that follows.

Shards and maps of earlier versions are searched so; ``test_inverted`` is about the others.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import identity_metric, learned_metric
from placefield.matching.comparing import MetricPlaces
from placefield.matching.filter_matcher import within_reach
from placefield.search.coarse import AXES

Array = NDArray[np.float32]


def route(places: int, dimensions: int, seed: int = 0) -> Array:
    """A walk whose dimensions vary less and less, of unit length."""
    rng = np.random.default_rng(seed)
    spread = 1 / np.sqrt(1 + np.arange(dimensions) / 5)
    walk = np.cumsum(rng.normal(size=(places, dimensions)), axis=0) % 40 - 20
    walk = (walk * spread).astype(np.float32)
    return np.asarray(walk / np.linalg.norm(walk, axis=1, keepdims=True), np.float32)


def other_light(frames: Array, seed: int = 1) -> Array:
    noise = np.random.default_rng(seed).normal(size=frames.shape) / np.sqrt(frames.shape[1])
    observed = frames + 0.5 * noise
    return np.asarray(observed / np.linalg.norm(observed, axis=1, keepdims=True), np.float32)


@pytest.fixture(scope="module", params=["identity", "learned"])
def metric_and_query(request: pytest.FixtureRequest) -> tuple[MapMetric, Array]:
    places = route(6000, 150)
    query = other_light(places[1000:1040])
    if request.param == "identity":
        return unlisted(identity_metric(places, coarse=True)), query
    v = np.eye(150) + 0.03 * np.random.default_rng(2).normal(size=(150, 150))
    return unlisted(learned_metric(v.astype(np.float32), places, coarse=True)), query


def unlisted(metric: MapMetric) -> MapMetric:
    """A metric whose index has no lists."""
    assert metric.coarse is not None
    return replace(metric, coarse=replace(metric.coarse, lists=None))


def test_the_nearest_places_have_exact_distances_and_the_others_nearly_so(
    metric_and_query: tuple[MapMetric, Array],
) -> None:
    metric, query = metric_and_query
    coarse = MetricPlaces(metric, exact=False).compare(query)
    exact = MetricPlaces(metric, exact=True).compare(query)
    for rough, right in zip(coarse, exact, strict=True):
        assert not rough.is_exact
        assert right.is_exact
        nearest = np.argsort(right.distances)[:10]
        np.testing.assert_array_equal(rough.distances[nearest], right.distances[nearest])
        assert np.corrcoef(rough.distances, right.distances)[0, 1] > 0.9


def test_the_deviation_is_that_of_the_exact_distances(
    metric_and_query: tuple[MapMetric, Array],
) -> None:
    metric, query = metric_and_query
    for rough, right in zip(
        MetricPlaces(metric, exact=False).compare(query),
        MetricPlaces(metric, exact=True).compare(query),
        strict=True,
    ):
        assert right.deviation == pytest.approx(right.distances.std(dtype=np.float64))
        assert rough.deviation == pytest.approx(right.deviation, rel=1e-6)


def test_a_batch_gives_the_same_bits_as_one_by_one(
    metric_and_query: tuple[MapMetric, Array],
) -> None:
    metric, query = metric_and_query
    places = MetricPlaces(metric, exact=False)
    for number, batched in enumerate(places.compare(query)):
        (alone,) = places.compare(query[number : number + 1])
        np.testing.assert_array_equal(alone.distances, batched.distances)
        assert alone.deviation == batched.deviation


@pytest.mark.parametrize("reversed", [False, True])
def test_distances_to_chosen_places_are_reranked(
    metric_and_query: tuple[MapMetric, Array], reversed: bool
) -> None:
    metric, query = metric_and_query
    (rough,) = MetricPlaces(metric, exact=False).compare(query[:1])
    (right,) = MetricPlaces(metric, exact=True).compare(query[:1])
    chosen = np.array([0, 17, 3000, 5999], np.int32)
    if reversed:
        rough, right = rough.reversed(), right.reversed()
    made = rough.reranked(chosen)
    np.testing.assert_array_equal(made.distances[chosen], right.distances[chosen])
    others = np.setdiff1d(np.arange(6000), chosen)
    np.testing.assert_array_equal(made.distances[others], rough.distances[others])
    assert made.is_reversed == reversed


def test_of_few_dimensions_all_are_used() -> None:
    index = identity_metric(route(500, 20), coarse=True).coarse
    assert index is not None
    assert index.axes.shape == (20, 20)
    np.testing.assert_allclose(index.axes @ index.axes.T, np.eye(20), atol=1e-5)


def test_axes_are_those_along_which_places_vary_most() -> None:
    places = route(3000, 150)
    index = identity_metric(places, coarse=True).coarse
    assert index is not None
    assert index.codes.shape == (3000, AXES)
    assert index.codes.dtype == np.int8
    kept = ((places @ index.axes.T) ** 2).sum()
    best = (np.linalg.svd(places, compute_uv=False)[:AXES] ** 2).sum()
    assert kept == pytest.approx(best, rel=1e-3)


def test_what_is_within_reach_are_the_places_and_the_next_twelve() -> None:
    reached = within_reach(np.array([3, 4, 97, 99], np.int32), 100)
    assert reached.tolist() == [*range(3, 17), 97, 98, 99]
    assert within_reach(np.array([], np.int32), 100).tolist() == []
