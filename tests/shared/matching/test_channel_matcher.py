from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.config import Rule
from placefield.maps.map import Map
from placefield.matching.candidate import NO_CANDIDATE, UNANSWERED, Candidate
from placefield.matching.channel_matcher import FilterMatcher, WindowMatcher, matcher_of
from placefield.matching.distances import PlaceDistances

Array = NDArray[np.float32]
WINDOW_RULES: list[Rule] = ["evidence", "lowest-score"]


def random_walk(frames: int, seed: int) -> Array:
    steps = np.random.default_rng(seed).normal(size=(frames, 5))
    return np.cumsum(steps, axis=0).astype(np.float32)


def matcher(places: int, scales: list[int], rule: Rule) -> WindowMatcher:
    projection = np.random.default_rng(9).normal(size=(5, 5)).astype(np.float32)
    return WindowMatcher(PlaceDistances(projection, random_walk(places, 1)), scales, rule)


def bits(candidate: Candidate) -> tuple[int, float, bytes]:
    return candidate.place, candidate.score, candidate.evidence.tobytes()


@pytest.mark.parametrize("rule", WINDOW_RULES)
@given(
    places=st.integers(3, 40),
    scales=st.lists(st.integers(2, 12), min_size=1, max_size=3, unique=True).map(sorted),
    seen=st.lists(st.booleans(), min_size=1, max_size=40),
    seed=st.integers(0, 99),
)
@settings(max_examples=60)
def test_what_came_before_the_longest_window_changes_not_one_bit(
    rule: Rule, places: int, scales: list[int], seen: list[bool], seed: int
) -> None:
    """Where the window begins with frames unseen, the last frame seen before them is part of it."""
    query = [
        row if there else None
        for row, there in zip(random_walk(len(seen), seed), seen, strict=True)
    ]
    old = matcher(places, scales, rule)
    candidates = [old.push(descriptor) for descriptor in query]
    begin = max(len(query) - old.memory, 0)
    while begin > 0 and query[begin] is None:
        begin -= 1
    new = matcher(places, scales, rule)
    for descriptor in query[begin:]:
        candidate = new.push(descriptor)
    assert bits(candidate) == bits(candidates[-1])


@pytest.mark.parametrize("rule", WINDOW_RULES)
def test_frames_unseen_leave_the_others_on_their_diagonal(rule: Rule) -> None:
    places = random_walk(60, 1)
    channel = WindowMatcher(PlaceDistances(np.eye(5, dtype=np.float32), places), [4, 8, 12], rule)
    for frame in range(60):
        candidate = channel.push(None if frame in (20, 21, 40) else places[frame])
        if frame >= 12:
            assert candidate.place == frame


@pytest.mark.parametrize("rule", WINDOW_RULES)
def test_a_maps_channel_is_matched_under_its_metric_at_its_scales(
    small_map: Map, rule: Rule
) -> None:
    channel = small_map.channels[1]
    made = matcher_of(channel, rule)
    by_hand = WindowMatcher(
        PlaceDistances(channel.projection, channel.places), [int(s) for s in channel.scales], rule
    )
    assert made.memory == channel.scales.max()
    for descriptor in channel.places:
        assert bits(made.push(descriptor)) == bits(by_hand.push(descriptor))


def route_filter(places: Array) -> FilterMatcher:
    return FilterMatcher(PlaceDistances(np.eye(5, dtype=np.float32), places), persistence=8)


def test_the_filter_follows_a_route_past_frames_unseen() -> None:
    places = random_walk(60, 1)
    channel = route_filter(places)
    for frame in range(60):
        candidate = channel.push(None if frame in (20, 21, 40) else places[frame])
        assert candidate.evidence.shape == (60,)
        assert candidate.evidence.dtype == np.float32
        assert candidate.score == candidate.evidence[candidate.place] == candidate.evidence.max()
        if frame >= 5:
            assert candidate.place == frame


def test_the_filter_has_no_candidate_before_the_first_frame_that_was_seen() -> None:
    places = random_walk(30, 1)
    late, prompt = route_filter(places), route_filter(places)
    for _ in range(5):
        assert late.push(None) is NO_CANDIDATE
    for descriptor in [*places[:10], None, None, *places[12:]]:
        assert bits(late.push(descriptor)) == bits(prompt.push(descriptor))


def test_a_filters_candidate_stays_what_it_was() -> None:
    places = random_walk(30, 1)
    channel = route_filter(places)
    candidate = channel.push(places[0])
    kept = candidate.evidence.copy()
    for descriptor in places[1:]:
        channel.push(descriptor)
    np.testing.assert_array_equal(candidate.evidence, kept)


def test_after_its_memory_the_filter_is_found_by_what_it_sees_next_alone() -> None:
    places = random_walk(300, 1)
    back = places[30:40]
    found = []
    for unseen in (FilterMatcher.memory, 4 * FilterMatcher.memory):
        channel = route_filter(places)
        for descriptor in [*places[:60], *[None] * unseen, *back]:
            candidate = channel.push(descriptor)
        found.append(candidate)
    assert [candidate.place for candidate in found] == [39, 39]
    np.testing.assert_allclose(found[0].evidence, found[1].evidence, atol=0.01)


def test_a_speed_lasts_as_long_as_the_mean_scale_of_a_maps_channel(small_map: Map) -> None:
    channel = replace(small_map.channels[1], scales=np.array([4, 9, 20], np.int32))
    distances = PlaceDistances(channel.projection, channel.places)
    made, by_hand = matcher_of(channel, "filter"), FilterMatcher(distances, persistence=11)
    assert made.memory == FilterMatcher.memory
    for descriptor in channel.places:
        assert bits(made.push(descriptor)) == bits(by_hand.push(descriptor))


@pytest.mark.parametrize("rule", get_args(Rule))
def test_in_reverse_a_route_is_matched_as_one_whose_places_come_the_other_way(
    small_map: Map, rule: Rule
) -> None:
    channel = small_map.channels[0]
    last = len(channel.places) - 1
    turned = matcher_of(replace(channel, places=channel.places[::-1].copy()), rule)
    reverse = matcher_of(channel, rule, reverse=True)
    assert reverse.memory == turned.memory
    stream = [None, *channel.places[::-1][:10], None, *channel.places[::-1][11:]]
    for descriptor in stream:
        expected, candidate = turned.push(descriptor), reverse.push(descriptor)
        answered = expected.place != UNANSWERED
        assert candidate.place == (last - expected.place if answered else UNANSWERED)
        assert candidate.score == expected.score
        assert np.array_equal(candidate.evidence, expected.evidence[::-1])
    assert candidate.place == 0
