import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import identity_metric, learned_metric
from placefield.matching import comparing
from placefield.matching.comparing import Comparison, MetricPlaces, distance_matrix

Array = NDArray[np.float32]
DIMENSIONS = 40


def unit_vectors(count: int, seed: int) -> Array:
    vectors = np.random.default_rng(seed).normal(size=(count, DIMENSIONS))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), np.float32)


def metric_of(learned: bool, places: Array) -> MapMetric:
    """The identity, or a metric of fewer dimensions, that stretches some of them by far."""
    if not learned:
        return identity_metric(places)
    rng = np.random.default_rng(9)
    projection = np.geomspace(0.1, 30, 25)[:, None] * rng.normal(size=(25, DIMENSIONS))
    return learned_metric(projection.astype(np.float32), places)


PLACES = unit_vectors(300, seed=1)
METRICS = {learned: metric_of(learned, PLACES) for learned in (False, True)}


def exactly(learned: bool) -> MetricPlaces:
    return MetricPlaces(METRICS[learned], exact=True)


def bits(frame: Comparison) -> tuple[bytes, bytes]:
    return frame.descriptor.tobytes(), frame.distances.tobytes()


@pytest.mark.parametrize("learned", [False, True])
def test_distances_are_those_of_the_equation(learned: bool) -> None:
    metric, query = METRICS[learned], unit_vectors(30, seed=2)
    projection = metric.projection.astype(np.float64)
    longest = np.linalg.norm(projection, 2)
    for descriptor, frame in zip(query, exactly(learned).compare(query), strict=True):
        apart = (descriptor - PLACES.astype(np.float64)) @ projection.T / longest
        assert frame.distances.dtype == np.int32
        distances = frame.distances * (metric.unit / longest) ** 2
        np.testing.assert_allclose(distances, (apart**2).sum(axis=1), atol=2e-3)
        np.testing.assert_allclose(frame.descriptor, projection @ descriptor / metric.unit, atol=3)


@pytest.mark.parametrize("learned", [False, True])
def test_distances_are_exactly_those_of_the_quantized_descriptors(learned: bool) -> None:
    metric = METRICS[learned]
    for frame in exactly(learned).compare(unit_vectors(30, seed=2)):
        apart = frame.descriptor.astype(np.int64) - metric.places
        np.testing.assert_array_equal(frame.distances, (apart**2).sum(axis=1))


@pytest.mark.parametrize("learned", [False, True])
def test_a_place_is_at_no_distance_of_itself(learned: bool) -> None:
    for place, frame in enumerate(exactly(learned).compare(PLACES)):
        assert frame.distances.min() == frame.distances[place] == 0


@pytest.mark.parametrize("learned", [False, True])
@pytest.mark.parametrize("at_once", [comparing._AT_ONCE, 1, 7 * 300, 30 * 300])
@given(splits=st.lists(st.integers(0, 60), max_size=6).map(sorted), seed=st.integers(0, 99))
@settings(max_examples=25)
def test_a_frame_compares_alone_as_in_any_batch_to_the_last_bit(
    learned: bool, at_once: int, splits: list[int], seed: int
) -> None:
    query = unit_vectors(60, seed)
    places = exactly(learned)
    alone = [bits(frame) for one in query for frame in places.compare(one[None])]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparing, "_AT_ONCE", at_once)
        batches = np.split(query, splits)
        batched = [bits(frame) for batch in batches for frame in places.compare(batch)]
    assert batched == alone


def test_a_comparison_stays_what_it_was() -> None:
    places = exactly(True)
    frames = places.compare(unit_vectors(40, seed=2))
    first = next(frames)
    kept = bits(first)
    for _ in (*frames, *places.compare(unit_vectors(40, seed=3))):
        pass
    assert bits(first) == kept


def test_no_descriptors_are_no_comparisons() -> None:
    for learned in METRICS:
        assert list(exactly(learned).compare(np.empty((0, DIMENSIONS), np.float32))) == []


@pytest.mark.parametrize("learned", [False, True])
def test_a_distance_matrix_has_a_row_for_each_frame_observed_or_missing(learned: bool) -> None:
    metric, query = METRICS[learned], unit_vectors(30, seed=2)
    observed = [None if frame in (0, 7, 29) else one for frame, one in enumerate(query)]
    matrix = distance_matrix(metric, observed, np.inf)
    assert matrix.dtype == np.float32
    for row, one in zip(matrix, observed, strict=True):
        if one is None:
            assert np.isinf(row).all()
        else:
            (frame,) = exactly(learned).compare(one[None])
            np.testing.assert_allclose(row, metric.unit**2 * frame.distances, rtol=1e-6)


def test_a_distance_matrix_without_any_observation() -> None:
    np.testing.assert_array_equal(distance_matrix(METRICS[True], [None] * 3, 0), np.zeros((3, 300)))
