from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from comparisons import compared
from filters import filter_of, posterior_of, topology_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from reference_filter import ReferenceFilter
from windowed import mean_of

from placefield.config import MatchingConfig, Rule
from placefield.maps.map import Map, MapChannel, MapMetric
from placefield.maps.map_metrics import identity_metric, learned_metric
from placefield.matching.ams import AmsMatcher
from placefield.matching.candidate import NO_CANDIDATE, UNANSWERED, Candidate
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.comparing import Comparison
from placefield.matching.evidence import EvidenceMatcher
from placefield.matching.filter_matcher import FilterMatcher
from placefield.matching.matcher import Matcher
from placefield.matching.sharding import ChannelShard
from placefield.matching.window_matcher import MeanDistance, ShardPlaces, WindowMatcher

Array = NDArray[np.float32]
WINDOW_RULES: list[Rule] = ["evidence", "ams"]


def random_walk(frames: int, seed: int) -> Array:
    """Unit descriptors, each near the one before it."""
    rng = np.random.default_rng(seed)
    walk = rng.normal(size=8) + np.cumsum(0.3 * rng.normal(size=(frames, 8)), axis=0)
    return np.asarray(walk / np.linalg.norm(walk, axis=1, keepdims=True), np.float32)


def some_metric(places: Array) -> MapMetric:
    projection = np.random.default_rng(9).normal(size=(8, 8)).astype(np.float32)
    return learned_metric(projection, places)


def descriptors_of(metric: MapMetric) -> Array:
    """Descriptors of the places, of a metric that was not learned."""
    return np.asarray(metric.unit * metric.places, np.float32)


def matcher_of(channel: MapChannel, rule: Rule, *, reverse: bool = False) -> Matcher:
    """Return a matcher of a whole channel."""
    return ChannelShard(channel, MatchingConfig(rule=rule, reverse=reverse)).new_matcher()


def window_matcher(metric: MapMetric, scales: list[int], rule: Rule) -> WindowMatcher:
    """Return a matcher of windows of these lengths over all places."""
    made = {"evidence": EvidenceMatcher, "ams": AmsMatcher}[rule]
    every = slice(0, len(metric.places))
    places = ShardPlaces(len(metric.places), every, every)
    return made(scales, places, metric.unit, MeanDistance(metric), lags=[20])


def candidates_of(channel: Matcher, frames: list[Comparison | None]) -> list[Candidate]:
    return [channel.update(frame) for frame in frames]


def bits(candidate: Candidate) -> tuple[int, float, bytes, bytes]:
    return (
        candidate.place,
        candidate.score,
        candidate.places.tobytes(),
        candidate.evidence.tobytes(),
    )


@pytest.mark.parametrize("rule", WINDOW_RULES)
@given(
    places=st.integers(3, 40) | st.just(300),
    scales=st.lists(st.integers(2, 12), min_size=1, max_size=3, unique=True).map(sorted),
    observed=st.lists(st.booleans(), min_size=1, max_size=60),
    seed=st.integers(0, 99),
)
@settings(max_examples=60)
def test_what_came_before_the_longest_window_changes_not_one_bit(
    rule: Rule, places: int, scales: list[int], observed: list[bool], seed: int
) -> None:
    """A window that begins with missing observations has the last observed frame in it."""
    metric = some_metric(random_walk(places, 1))
    walk = random_walk(len(observed), seed)
    frames = compared(
        metric, [row if there else None for row, there in zip(walk, observed, strict=True)]
    )
    old, new = (window_matcher(metric, scales, rule) for _ in range(2))
    candidates = candidates_of(old, frames)
    begin = max(len(frames) - old.horizon, 0)
    while begin > 0 and frames[begin] is None:
        begin -= 1
    assert bits(candidates_of(new, frames[begin:])[-1]) == bits(candidates[-1])


@pytest.mark.parametrize("rule", WINDOW_RULES)
def test_missing_observations_leave_the_others_on_their_diagonal(rule: Rule) -> None:
    places = random_walk(60, 1)
    metric = identity_metric(places)
    query = [None if frame in (20, 21, 40) else places[frame] for frame in range(60)]
    candidates = candidates_of(window_matcher(metric, [4, 8, 12], rule), compared(metric, query))
    assert [candidate.place for candidate in candidates[12:]] == list(range(12, 60))


@pytest.mark.parametrize("rule", WINDOW_RULES)
def test_a_maps_channel_is_matched_under_its_metric_at_its_scales(
    small_map: Map, rule: Rule
) -> None:
    channel = small_map.channels[1]
    made = matcher_of(channel, rule)
    scales = [int(scale) for scale in channel.scales]
    if rule == "ams":
        scales = sorted({channel.smallest, *scales})
    by_hand = window_matcher(channel.metric, scales, rule)
    assert made.horizon == channel.scales.max()
    for frame in compared(channel.metric, descriptors_of(channel.metric)):
        assert bits(made.update(frame)) == bits(by_hand.update(frame))


def test_the_filter_follows_a_route_past_missing_observations() -> None:
    places = random_walk(60, 1)
    metric = identity_metric(places)
    query = [None if frame in (20, 21, 40) else places[frame] for frame in range(60)]
    candidates = candidates_of(filter_of(metric), compared(metric, query))
    for candidate in candidates:
        assert candidate.places.dtype == np.int32
        assert candidate.evidence.dtype == np.float32
        assert np.all(np.diff(candidate.places) > 0)
        (best,) = candidate.evidence[candidate.places == candidate.place]
        assert candidate.score == best == candidate.evidence.max()
    assert [candidate.place for candidate in candidates[5:]] == list(range(5, 60))


def test_the_filter_has_no_candidate_before_the_first_observation() -> None:
    places = random_walk(30, 1)
    metric = identity_metric(places)
    late, prompt = filter_of(metric), filter_of(metric)
    for _ in range(5):
        assert late.update(None) is NO_CANDIDATE
    for frame in compared(metric, [*places[:10], None, None, *places[12:]]):
        assert bits(late.update(frame)) == bits(prompt.update(frame))


@pytest.mark.parametrize("rule", get_args(Rule))
def test_a_candidate_stays_what_it_was(small_map: Map, rule: Rule) -> None:
    channel = small_map.channels[0]
    for reverse in (False, True):
        matcher = matcher_of(channel, rule, reverse=reverse)
        first, *others = compared(channel.metric, descriptors_of(channel.metric))
        candidate = matcher.update(first)
        kept = bits(candidate)
        candidates_of(matcher, others)
        assert bits(candidate) == kept


def test_after_its_memory_the_filter_is_found_by_what_it_sees_next_alone() -> None:
    places = random_walk(300, 1)
    metric = identity_metric(places)
    found = []
    for unobserved in (FilterMatcher.horizon, 4 * FilterMatcher.horizon):
        query = [*places[:60], *[None] * unobserved, *places[30:40]]
        candidate = candidates_of(filter_of(metric), compared(metric, query))[-1]
        beliefs = np.zeros(300)
        beliefs[candidate.places] = candidate.evidence
        found.append((candidate.place, beliefs))
    assert [place for place, _ in found] == [39, 39]
    np.testing.assert_allclose(found[0][1], found[1][1], atol=0.01)


def test_what_is_left_out_of_a_posterior_is_negligible() -> None:
    """As when it is spread over a long map, or is all on a single place of it."""
    places = random_walk(5000, 1)
    metric = identity_metric(places)
    reference = ReferenceFilter(descriptors_of(metric).astype(np.float64))
    matcher = filter_of(metric)
    for number, frame in enumerate(compared(metric, [*places[:20], *[None] * 30])):
        candidate = matcher.update(frame)
        reference.update(
            None if frame is None else metric.unit * frame.descriptor.astype(np.float64)
        )
        left_out = reference.belief() - posterior_of(candidate, 5000)
        assert left_out.max() <= 1.1e-6
        assert left_out.sum() < 0.005 or number > 45


@pytest.mark.parametrize("rule", get_args(Rule))
@pytest.mark.parametrize("count", [1, 2, 3, 90])
def test_in_reverse_a_route_is_matched_as_one_whose_places_come_the_other_way(
    small_map: Map, rule: Rule, count: int
) -> None:
    """To the last bit under the windows' rules; the filter adds up its means in another order."""
    forth = small_map.channels[0]
    places = descriptors_of(forth.metric)[:count]
    forth = replace(forth, metric=identity_metric(places))
    back = replace(forth, metric=identity_metric(places[::-1]))
    last = count - 1
    reverse, reversed = matcher_of(forth, rule, reverse=True), matcher_of(back, rule)
    assert reverse.horizon == reversed.horizon
    query = [None, *places[::-1][:10], None, *places[::-1][11:]]
    rtol = 1e-4 if rule == "filter" else 0
    for there, here in zip(
        compared(back.metric, query), compared(forth.metric, query), strict=True
    ):
        expected, candidate = reversed.update(there), reverse.update(here)
        answered = expected.place != UNANSWERED
        assert candidate.place == (last - expected.place if answered else UNANSWERED)
        assert candidate.score == pytest.approx(expected.score, rel=rtol, abs=0)
        assert candidate.places.tolist() == [last - place for place in expected.places[::-1]]
        np.testing.assert_allclose(candidate.evidence, expected.evidence[::-1], rtol=rtol)
        assert candidate.too_fast == pytest.approx(expected.too_fast, rel=rtol)
        assert (candidate.too_fast > 0) == (answered and rule == "filter")
    assert count < 90 or candidate.place == 0


@pytest.mark.parametrize("rule", WINDOW_RULES)
def test_in_reverse_windows_smooth_a_route_as_one_whose_places_come_the_other_way(
    small_map: Map, rule: Rule
) -> None:
    forth = small_map.channels[0]
    places = descriptors_of(forth.metric)[:90]
    forth = replace(forth, metric=identity_metric(places))
    back = replace(forth, metric=identity_metric(places[::-1]))
    query = [None, *places[::-1][:10], None, *places[::-1][11:], None]
    smoothed = []
    for channel, reverse in ((forth, True), (back, False)):
        matcher, frames = matcher_of(channel, rule, reverse=reverse), []
        for frame in [*compared(channel.metric, query), *[None] * matcher.tail]:
            matcher.update(frame)
            frames += matcher.smoothed()
        smoothed.append(frames + matcher.finish())
    assert len(smoothed[0]) == len(smoothed[1]) == len(query)
    for candidate, expected in zip(*smoothed, strict=True):
        assert bits(candidate.candidate) == bits(expected.candidate.reversed(90))
        assert candidate.lag == expected.lag


def test_in_reverse_odometry_is_followed_as_on_a_route_whose_places_come_the_other_way(
    small_map: Map,
) -> None:
    forth = small_map.channels[0]
    places = descriptors_of(forth.metric)[:90]
    forth = replace(forth, metric=identity_metric(places))
    back = replace(forth, metric=identity_metric(places[::-1]))
    travelled = np.cumsum(np.random.default_rng(1).uniform(0, 3, 90))
    positions = np.random.default_rng(2).integers(-1, 9, 20).cumsum()
    observed = [int(place) for place in positions if 0 <= place < 90]
    readings = [float(travelled[-1] - travelled[89 - place]) for place in observed]
    reverse = ChannelStage(
        {0: forth}, MatchingConfig(reverse=True), topology=topology_of(travelled)
    )
    back_along = topology_of(travelled[-1] - travelled[::-1])
    reversed = ChannelStage({0: back}, MatchingConfig(), topology=back_along)
    without = ChannelStage({0: back}, MatchingConfig())
    streams = [stage.new_stream() for stage in (reverse, reversed, without)]
    stages = (reverse, reversed, without)
    differ = False
    for place, reading in zip(observed, readings, strict=True):
        frame = places[::-1][place]
        (there,), (here,), (blind,) = (
            stream.update(next(stage.compare([frame])), reading)
            for stage, stream in zip(stages, streams, strict=True)
        )
        assert there.place == 89 - here.place
        np.testing.assert_allclose(there.evidence, here.evidence[::-1], rtol=1e-4)
        differ |= here.score != blind.score
    assert differ


@pytest.mark.parametrize("places", [1, 7, 300])
def test_the_mean_distance_is_that_of_the_distances_to_the_last_bit(places: int) -> None:
    metric = some_metric(random_walk(places, 1))
    mean_distance = MeanDistance(metric)
    for frame in compared(metric, [*random_walk(50, 2)]):
        assert frame is not None
        assert mean_distance(frame.descriptor) == mean_of(frame.distances)
