"""The filter against its model, state by state."""

import numpy as np
import pytest
from comparisons import comparison, comparison_at, metric_of_codes
from filters import filter_of, push
from hypothesis import given, settings
from hypothesis import strategies as st
from literal_filter import LiteralFilter
from numpy.typing import NDArray

from placefield.matching.comparing import Comparison
from placefield.matching.filter_step import _BLOCK
from placefield.matching.place_filter import PlaceFilter
from placefield.metric.codes import DESCRIPTOR_UNIT, Codes, codes_of

Point = list[int]
UNIT = 0.25  # of small maps' codes

points = st.lists(st.integers(-6, 6), min_size=3, max_size=3)
"""Coarse, so that some coincide."""


def beliefs_of(place_filter: PlaceFilter) -> NDArray[np.float64]:
    """By sheet, speed and place, (2, S, K)."""
    return place_filter._belief.astype(np.float64) / place_filter._total


def assert_the_model_is_followed(
    places: Codes, unit: float, query: list[Codes | None], persistence: float
) -> None:
    """Assert that the beliefs are those of the literal filter after every frame."""
    metric = metric_of_codes(places, unit)
    place_filter = filter_of(metric, persistence)
    literal = LiteralFilter(unit * places.astype(np.float64), persistence)
    for frame in query:
        push(place_filter, None if frame is None else comparison(metric, frame))
        literal.push(None if frame is None else unit * frame.astype(np.float64))
        expected = literal.beliefs
        np.testing.assert_allclose(beliefs_of(place_filter), expected, rtol=1e-4, atol=1e-12)
        np.testing.assert_allclose(
            place_filter.belief, expected[0].sum(axis=0), rtol=1e-4, atol=1e-12
        )
        assert place_filter._lost / place_filter._total == pytest.approx(literal.lost, rel=1e-4)


@st.composite
def maps(draw: st.DrawFn) -> Codes:
    places = draw(st.lists(points, min_size=1, max_size=7))
    return np.array(draw(st.sampled_from([places, places[:1] * len(places)])), np.int16)


@st.composite
def queries(draw: st.DrawFn) -> list[Codes | None]:
    """Each frame is new, not seen, or the last one that was seen once more."""
    frames: list[Codes | None] = []
    last: Codes | None = None
    for frame in draw(st.lists(points | st.sampled_from(["unseen", "again"]), max_size=10)):
        last = np.array(frame, np.int16) if isinstance(frame, list) else last
        frames.append(None if frame == "unseen" else last)
    return frames


@given(maps(), st.sampled_from([0.5, 1, 4, 12.5]), queries())
@settings(max_examples=100)
def test_belief_is_that_of_the_model(
    places: Codes, persistence: float, query: list[Codes | None]
) -> None:
    assert_the_model_is_followed(places, UNIT, query, persistence)


def random_walk(count: int, seed: int) -> Codes:
    """Codes of unit vectors, each near the one before it."""
    rng = np.random.default_rng(seed)
    walk = rng.normal(size=6) + np.cumsum(0.3 * rng.normal(size=(count, 6)), axis=0)
    return codes_of(walk / np.linalg.norm(walk, axis=1, keepdims=True), DESCRIPTOR_UNIT)


@pytest.mark.parametrize(
    "count", [1, 2, 3, 999, 1000, 1001, _BLOCK - 1, _BLOCK, _BLOCK + 1, _BLOCK + 2, 5000]
)
def test_belief_is_that_of_the_model_in_maps_of_any_number_of_blocks(count: int) -> None:
    places = random_walk(count, seed=1)
    frames = random_walk(8, seed=2)
    query = [*frames[:3], frames[2], None, *frames[3:]]
    assert_the_model_is_followed(places, DESCRIPTOR_UNIT, query, persistence=9)


@pytest.mark.parametrize("step", [-2, -1, 1, 2])
@pytest.mark.parametrize("border", [_BLOCK, 2 * _BLOCK])
def test_belief_is_that_of_the_model_when_driving_from_block_to_block(
    border: int, step: int
) -> None:
    """In the map, and the other way, as the decoy is driven."""
    places = random_walk(2 * _BLOCK + 4, seed=1)
    driven = np.arange(border - 6 * step, border + 4 * step, step)
    noise = np.random.default_rng(2).integers(-40, 41, (len(driven), 6), np.int16)
    query = [places[min(place, len(places) - 1)] + noise[i] for i, place in enumerate(driven)]
    assert_the_model_is_followed(places, DESCRIPTOR_UNIT, query, persistence=9)


def assert_is_a_probability(place_filter: PlaceFilter) -> None:
    belief = place_filter.belief
    assert np.isfinite(belief).all()
    assert belief.min() >= 0
    assert belief.sum() <= 1 + 1e-5
    lost = place_filter._lost / place_filter._total
    assert 0 <= lost <= 1
    assert beliefs_of(place_filter).sum() + lost == pytest.approx(1, abs=1e-5)
    best, places, beliefs = place_filter.believed(1e-6)
    assert np.all(np.diff(places) > 0)
    assert places[best] == np.argmax(belief)
    np.testing.assert_allclose(beliefs, belief[places], rtol=1e-6)
    assert np.all(np.delete(belief, places) < 1.001e-6)


codes = st.lists(st.integers(-2300, 2300), min_size=3, max_size=3)
seen = st.tuples(codes, st.lists(st.integers(0, (2 * 4015) ** 2), min_size=7, max_size=7))


@given(maps(), st.lists(seen | st.none(), max_size=12))
def test_belief_is_a_probability_whatever_comes(
    places: Codes, query: list[tuple[Point, list[int]] | None]
) -> None:
    metric = metric_of_codes(places, DESCRIPTOR_UNIT)
    place_filter = filter_of(metric, 8)
    for frame in query:
        if frame is None:
            push(place_filter, None)
        else:
            frame_codes, distances = frame
            there = np.array(distances[: len(places)])
            push(place_filter, comparison_at(metric, np.array(frame_codes, np.int16), there))
        assert_is_a_probability(place_filter)


def test_one_place_of_very_many_that_stands_out_takes_the_others_belief_but_does_no_harm() -> None:
    """So far from the mean that the others' likelihood is below what float32 has."""
    metric = metric_of_codes(random_walk(30_000, seed=1), DESCRIPTOR_UNIT)
    place_filter = filter_of(metric, 8)
    for frame, place in enumerate((7, 8, 20_000, 20_001, 20_002)):
        distances = np.full(30_000, 5_000_000, np.int32)
        distances[place] = 0
        push(place_filter, comparison_at(metric, metric.places[place], distances))
        assert_is_a_probability(place_filter)
        best, places, _ = place_filter.believed(1e-6)
        assert places[best] == place or frame == 2


LONG = 20_000  # frames
ROUTE = metric_of_codes(random_walk(50, seed=1), DESCRIPTOR_UNIT)
AROUND = [comparison(ROUTE, place) for place in ROUTE.places]
ELSEWHERE = [comparison(ROUTE, codes_of(axis, DESCRIPTOR_UNIT)) for axis in np.eye(6)]
ALIKE = [comparison_at(ROUTE, place, np.full(50, 10_000)) for place in ROUTE.places]


@pytest.mark.parametrize(
    "stream",
    [AROUND, AROUND[20:21], ELSEWHERE, ALIKE, [AROUND[5], *[None] * (LONG - 2), AROUND[7]]],
    ids=["around and around", "standing", "elsewhere", "alike", "unseen"],
)
def test_belief_is_a_probability_after_a_long_stream(stream: list[Comparison | None]) -> None:
    place_filter = filter_of(ROUTE, 8)
    for frame in range(LONG):
        push(place_filter, stream[frame % len(stream)])
        if frame % 1000 == 0 or frame == LONG - 1:
            assert_is_a_probability(place_filter)
    if stream is AROUND:
        assert np.argmax(place_filter.belief) == (LONG - 1) % 50


@pytest.mark.parametrize("count", [1, 2, 50, 3000])
def test_what_is_believed_in_is_told_as_long_as_it_is_as_likely_as_asked(count: int) -> None:
    metric = metric_of_codes(random_walk(count, seed=1), DESCRIPTOR_UNIT)
    place_filter = filter_of(metric, 8)
    for frame in metric.places[:20]:
        push(place_filter, comparison(metric, frame))
        belief = place_filter.belief
        for least in (0, 1e-6, 1e-3, 0.1, 2):
            best, places, beliefs = place_filter.believed(least)
            assert (places.dtype, beliefs.dtype) == (np.int32, np.float32)
            assert np.all(np.diff(places) > 0)
            assert places[best] == np.argmax(belief)
            np.testing.assert_allclose(beliefs, belief[places], rtol=1e-6)
            left_out = np.delete(belief, places)
            assert len(left_out) == 0 or left_out.max() <= least * (1 + 1e-6)
            assert len(places) == 1 or beliefs.min() >= least * (1 - 1e-6)
    assert len(place_filter.believed(0)[1]) == count
