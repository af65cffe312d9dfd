"""The filter against its model, written out."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from comparisons import comparison, comparison_at, metric_of_quantized
from filters import filter_of, posterior_of, topology_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from reference_filter import ReferenceFilter
from route_networks import networks

from placefield.maps.map_metrics import steps_along
from placefield.maps.topology import Topology
from placefield.matching.candidate import NO_CANDIDATE, Candidate
from placefield.matching.comparing import Comparison
from placefield.matching.odometry import Odometer
from placefield.search.quantized import DESCRIPTOR_UNIT, Quantized, quantize

Point = list[int]
UNIT = 0.25  # of the quantized places of small maps
LEFT_OUT = 1e-6  # posterior
BLOCK = 1024  # places that a compiled loop does at once

points = st.lists(st.integers(-6, 6), min_size=3, max_size=3)
"""CoarseIndex, so that some coincide."""


def assert_the_model_is_followed(
    places: Quantized,
    unit: float,
    query: list[Quantized | None],
    topology: Topology | None = None,
    readings: Sequence[float | None] | None = None,
) -> None:
    """Assert that the posteriors are the reference filter's, filtered and smoothed."""
    metric = metric_of_quantized(places, unit)
    if topology is not None:
        metric = replace(metric, steps=steps_along(places, unit, topology.graph))
    matcher = filter_of(metric, lag=1000, topology=topology)
    reference, odometer = ReferenceFilter(unit * places.astype(np.float64), topology), Odometer()
    smoothed, last = [], None
    for frame, reading in zip(query, readings or [None] * len(query), strict=True):
        observation = None if frame is None else comparison(metric, frame)
        candidate = matcher.update(observation, reading)
        smoothed += matcher.smoothed()
        is_news = frame is None or last is None or bool((frame != last).any())
        displacement = (
            odometer.displacement(reading) if is_news and reference.route is not None else None
        )
        reference.update(None if frame is None else unit * frame.astype(np.float64), displacement)
        last = frame
        if not reference.filtered:
            assert candidate is NO_CANDIDATE
            continue
        posterior = posterior_of(candidate, len(places))
        np.testing.assert_allclose(posterior, reference.belief(), rtol=2e-4, atol=1.1 * LEFT_OUT)
    smoothed += matcher.finish()
    assert len(smoothed) == len(query)
    last = len(query) - 1
    for frame, (each, expected) in enumerate(zip(smoothed, reference.smoothed(), strict=True)):
        if expected is None:
            assert each.candidate is NO_CANDIDATE
        elif frame + each.lag == last:
            posterior = posterior_of(each.candidate, len(places))
            np.testing.assert_allclose(posterior, expected, rtol=1e-3, atol=1e-3)


@st.composite
def maps(draw: st.DrawFn) -> Quantized:
    places = draw(st.lists(points, min_size=1, max_size=7))
    return np.array(draw(st.sampled_from([places, places[:1] * len(places)])), np.int16)


@st.composite
def queries(draw: st.DrawFn) -> list[Quantized | None]:
    """Each frame is new, not observed, or the last one that was observed once more."""
    frames: list[Quantized | None] = []
    last: Quantized | None = None
    for frame in draw(st.lists(points | st.sampled_from(["unobserved", "again"]), max_size=10)):
        last = np.array(frame, np.int16) if isinstance(frame, list) else last
        frames.append(None if frame == "unobserved" else last)
    return frames


@pytest.mark.slow
@given(maps(), queries())
@settings(max_examples=100, deadline=None)
def test_posteriors_are_those_of_the_model(
    places: Quantized, query: list[Quantized | None]
) -> None:
    assert_the_model_is_followed(places, UNIT, query)


@pytest.mark.slow
@given(maps(), queries(), st.data())
@settings(max_examples=60, deadline=None)
def test_posteriors_are_those_of_the_model_with_odometry_as_well(
    places: Quantized, query: list[Quantized | None], data: st.DataObject
) -> None:
    gaps = data.draw(st.lists(st.sampled_from([0.0, 0.5, 1.0, 7.0]), min_size=7, max_size=7))
    steps = st.sampled_from([0.0, 0.3, 1.0, 2.5, 40.0, None])
    steps_m = data.draw(st.lists(steps, min_size=len(query), max_size=len(query)))
    total = np.cumsum([step or 0.0 for step in steps_m])
    readings = [
        None if step is None else float(so_far) for step, so_far in zip(steps_m, total, strict=True)
    ]
    travelled = np.cumsum(gaps)[: len(places)]
    assert_the_model_is_followed(places, UNIT, query, topology_of(travelled), readings)


@pytest.mark.slow
@given(st.integers(2, 40), st.integers(0, 10**6), st.data())
@settings(max_examples=20, deadline=None)
def test_posteriors_are_those_of_the_model_on_any_network_of_routes(
    count: int, seed: int, data: st.DataObject
) -> None:
    """The frames come along the places in order, then from anywhere."""
    topology, places = data.draw(networks(count)), random_walk(count, seed)
    rng = np.random.default_rng(seed)
    positions = [*range(min(count, 12)), *rng.integers(0, count, 8).tolist()]
    noise = rng.integers(-100, 101, (len(positions), 6), np.int16)
    query: list[Quantized | None] = [places[place] + noise[i] for i, place in enumerate(positions)]
    assert_the_model_is_followed(places, DESCRIPTOR_UNIT, [*query, None, query[0]], topology)


def random_walk(count: int, seed: int) -> Quantized:
    """Quantized of unit vectors, each near the one before it."""
    rng = np.random.default_rng(seed)
    walk = rng.normal(size=6) + np.cumsum(0.3 * rng.normal(size=(count, 6)), axis=0)
    return quantize(walk / np.linalg.norm(walk, axis=1, keepdims=True), DESCRIPTOR_UNIT)


@pytest.mark.parametrize(
    "count", [1, 2, 7, 8, 249, 250, 251, BLOCK - 1, BLOCK, BLOCK + 1, BLOCK + 8, 2500]
)
def test_posteriors_are_those_of_the_model_in_maps_of_any_number_of_blocks(count: int) -> None:
    places = random_walk(count, seed=1)
    frames = random_walk(8, seed=2)
    query = [*frames[:3], frames[2], None, *frames[3:]]
    assert_the_model_is_followed(places, DESCRIPTOR_UNIT, query)


@pytest.mark.parametrize("step", [-6, -1, 1, 2, 6])
@pytest.mark.parametrize("edge", [BLOCK, 2 * BLOCK])
def test_posteriors_are_those_of_the_model_when_moving_from_block_to_block(
    edge: int, step: int
) -> None:
    """On the map, and in reverse, as under the null hypothesis."""
    places = random_walk(2 * BLOCK + 4, seed=1)
    positions = np.arange(edge - 6 * step, edge + 4 * step, step)
    noise = np.random.default_rng(2).integers(-40, 41, (len(positions), 6), np.int16)
    query = [places[min(place, len(places) - 1)] + noise[i] for i, place in enumerate(positions)]
    assert_the_model_is_followed(places, DESCRIPTOR_UNIT, query)


def assert_is_a_posterior(candidate: Candidate, places: int) -> None:
    if candidate is NO_CANDIDATE:
        return
    assert (candidate.places.dtype, candidate.evidence.dtype) == (np.int32, np.float32)
    assert np.all(np.diff(candidate.places) > 0)
    posterior = posterior_of(candidate, places)
    assert np.isfinite(posterior).all()
    assert posterior.min() >= 0
    assert posterior.sum() <= 1 + 1e-5
    assert posterior[candidate.place] == posterior.max() == pytest.approx(candidate.score)


descriptors = st.lists(st.integers(-2300, 2300), min_size=3, max_size=3)
observed = st.tuples(descriptors, st.lists(st.integers(0, (2 * 4015) ** 2), min_size=7, max_size=7))


@given(maps(), st.lists(observed | st.none(), max_size=12))
@settings(deadline=None)
def test_posteriors_are_probabilities_whatever_comes(
    places: Quantized, query: list[tuple[Point, list[int]] | None]
) -> None:
    metric = metric_of_quantized(places, DESCRIPTOR_UNIT)
    matcher = filter_of(metric)
    smoothed = []
    for frame in query:
        observation = None
        if frame is not None:
            descriptor, distances = frame
            there = np.array(distances[: len(places)])
            observation = comparison_at(metric, np.array(descriptor, np.int16), there)
        assert_is_a_posterior(matcher.update(observation), len(places))
        smoothed += matcher.smoothed()
    smoothed += matcher.finish()
    assert len(smoothed) == len(query)
    for each in smoothed:
        assert_is_a_posterior(each.candidate, len(places))


def test_one_outstanding_place_of_very_many_gets_all_of_the_posterior_and_does_no_harm() -> None:
    """So far from the mean that float32 could not hold its likelihood."""
    metric = metric_of_quantized(random_walk(30_000, seed=1), DESCRIPTOR_UNIT)
    matcher = filter_of(metric)
    for frame, place in enumerate((7, 8, 20_000, 20_001, 20_002)):
        distances = np.full(30_000, 5_000_000, np.int32)
        distances[place] = 0
        candidate = matcher.update(comparison_at(metric, metric.places[place], distances))
        assert_is_a_posterior(candidate, 30_000)
        assert candidate.place == place or frame == 2


LONG = 3_000  # frames
ROUTE = metric_of_quantized(random_walk(50, seed=1), DESCRIPTOR_UNIT)
AROUND = [comparison(ROUTE, place) for place in ROUTE.places]
ELSEWHERE = [comparison(ROUTE, quantize(axis, DESCRIPTOR_UNIT)) for axis in np.eye(6)]
ALIKE = [comparison_at(ROUTE, place, np.full(50, 10_000)) for place in ROUTE.places]


@pytest.mark.parametrize(
    "stream",
    [AROUND, AROUND[20:21], ELSEWHERE, ALIKE, [AROUND[5], *[None] * (LONG - 2), AROUND[7]]],
    ids=["around and around", "stationary", "elsewhere", "alike", "unobserved"],
)
def test_posteriors_are_probabilities_after_a_long_stream(
    stream: list[Comparison | None],
) -> None:
    matcher = filter_of(ROUTE)
    smoothed = 0
    for frame in range(LONG):
        candidate = matcher.update(stream[frame % len(stream)])
        smoothed += len(matcher.smoothed())
        assert frame - smoothed < 20
        if frame % 1000 == 0 or frame == LONG - 1:
            assert_is_a_posterior(candidate, 50)
    if stream is AROUND:
        assert candidate.place == (LONG - 1) % 50


def candidates_of(places: Quantized, query: NDArray[np.int16]) -> list[Candidate]:
    metric = metric_of_quantized(places, DESCRIPTOR_UNIT)
    matcher = filter_of(metric)
    return [matcher.update(comparison(metric, frame)) for frame in query]


def test_a_repeated_frame_is_no_evidence_and_no_step_of_time() -> None:
    """As in a video at another rate."""
    places = random_walk(60, seed=1)
    once = candidates_of(places, places[:30])
    twice = candidates_of(places, np.repeat(places[:30], 3, axis=0))
    for number, candidate in enumerate(twice):
        expected = once[number // 3]
        assert candidate.place == expected.place
        np.testing.assert_array_equal(candidate.evidence, expected.evidence)
