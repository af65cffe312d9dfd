"""Shards against the whole map: together they answer as it would, frame for frame."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from comparisons import comparison, metric_of_quantized
from filters import SCALES, channel_of, topology_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from route_networks import network

from placefield.config import MatchingConfig, Rule
from placefield.errors import ConfigError
from placefield.fusion.rules import fuse
from placefield.fusion.shard_joiner import join_shards
from placefield.maps.map import MapChannel, MapMetric
from placefield.maps.map_metrics import identity_metric, learned_metric, steps_along
from placefield.matching.best_window import vicinity_of
from placefield.matching.candidate import NO_CANDIDATE, Candidate
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.matcher import Matcher, Partial, SmoothedCandidate
from placefield.matching.sharding import ChannelShard, shard_range
from placefield.search.quantized import Quantized

pytestmark = pytest.mark.slow

Array = NDArray[np.float32]
Pair = tuple[Candidate, Candidate]
DIMENSIONS = 24
RULES = get_args(Rule)


def random_walk(count: int, seed: int) -> Array:
    """Unit descriptors, each near the one before it."""
    rng = np.random.default_rng(seed)
    walk = rng.normal(size=(count, DIMENSIONS))
    for place in range(1, count):
        walk[place] = 0.8 * walk[place - 1] + 0.6 * walk[place]
    return np.asarray(walk / np.linalg.norm(walk, axis=1, keepdims=True), np.float32)


def unlearned_channel(places: Array) -> MapChannel:
    return channel_of(identity_metric(places))


def learned_channel(places: Array) -> MapChannel:
    """A channel under whose metric places have many lengths."""
    noise = np.random.default_rng(9).normal(size=(DIMENSIONS, DIMENSIONS))
    return channel_of(learned_metric((np.eye(DIMENSIONS) + 0.3 * noise).astype(np.float32), places))


def a_drive(places: Array, *, reverse: bool) -> list[Array | None]:
    """A drive with a late start, stops, jumps, other routes and missing observations."""
    ordered = places[::-1] if reverse else places
    last = len(places) - 1
    positions = max(last // 2 - 60, 0) + np.cumsum(np.repeat([1, 2, 1, 0, 2, 1], 25))
    along = ordered[np.minimum(positions, last)]
    from_elsewhere = ordered[(last * 2 // 3 + np.arange(60)) % (last + 1)]
    other_route = random_walk(20, seed=77)
    the_other_way = ordered[np.arange(min(last, 70), 0, -1)]
    frames = np.concatenate([along, from_elsewhere, other_route, the_other_way])
    noise = 0.05 * np.random.default_rng(3).normal(size=frames.shape)
    observed = frames + noise.astype(np.float32)
    observed /= np.linalg.norm(observed, axis=1, keepdims=True)
    observed[90:100] = observed[90]  # to the last bit the same
    unobserved = {0, 1, 20, 40, 41, 42, 130, 160, 161, 162, 163, 200}
    return [None if number in unobserved else frame for number, frame in enumerate(observed)]


def whole_channel(channel: MapChannel, rule: Rule, *, reverse: bool) -> Matcher:
    return ChannelShard(channel, MatchingConfig(rule=rule, reverse=reverse)).new_matcher()


class Shards:
    """All shards of a channel in one process."""

    def __init__(
        self, channel: MapChannel, rule: Rule, shards: int, *, reverse: bool = False
    ) -> None:
        self.rule = rule
        self.parts = [
            ChannelShard(channel, MatchingConfig(rule=rule, reverse=reverse), shard, shards)
            for shard in range(shards)
        ]
        self.matchers: list[Matcher] = [part.new_matcher() for part in self.parts]
        self.partials: list[Partial] = []
        self.smoothed: list[SmoothedCandidate] = []

    def update(self, frames: Sequence[Comparison | None]) -> Candidate:
        """Process the comparisons of a frame in each shard, and return the joined candidate."""
        self.partials = [
            matcher.local(frame) for matcher, frame in zip(self.matchers, frames, strict=True)
        ]
        candidates = [matcher.reduce(self.partials) for matcher in self.matchers]
        self.smoothed += joined([matcher.smoothed() for matcher in self.matchers], self.rule)
        return join_shards(candidates, self.rule)

    def finish(self) -> list[SmoothedCandidate]:
        """Return all smoothed candidates at the end of the stream."""
        left = joined([matcher.finish() for matcher in self.matchers], self.rule)
        return self.smoothed + left


def joined(smoothed: Sequence[list[SmoothedCandidate]], rule: Rule) -> list[SmoothedCandidate]:
    """Join the smoothed candidates of all shards."""
    frames = []
    for of_frame in zip(*smoothed, strict=True):
        (lag,) = {each.lag for each in of_frame}
        frames.append(
            SmoothedCandidate(join_shards([each.candidate for each in of_frame], rule), lag)
        )
    return frames


def answers(
    channel: MapChannel,
    rule: Rule,
    shards: int,
    query: Sequence[Array | None],
    *,
    reverse: bool = False,
    exact: bool = True,
) -> Iterator[Pair]:
    """Match a query in the whole map and in its shards."""
    whole = whole_channel(channel, rule, reverse=reverse)
    parts = Shards(channel, rule, shards, reverse=reverse)
    metrics = [channel.metric, *(part.metric for part in parts.parts)]
    places = [MetricPlaces(metric, exact=exact) for metric in metrics]
    for descriptor in query:
        frame, *frames = [
            None if descriptor is None else next(compare.compare(descriptor[None]))
            for compare in places
        ]
        yield whole.update(frame), parts.update(frames)


def beliefs_of(candidate: Candidate, places: int) -> Array:
    beliefs = np.zeros(places, np.float32)
    beliefs[candidate.places] = candidate.evidence
    return beliefs


def assert_same_beliefs(whole: Candidate, joined: Candidate, places: int) -> None:
    if whole is NO_CANDIDATE:
        assert joined is NO_CANDIDATE
        return
    expected, found = beliefs_of(whole, places), beliefs_of(joined, places)
    # Rounding may lift a belief over the negligible ones.
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1.1e-6)
    assert np.all(np.diff(joined.places) > 0)
    assert joined.score == pytest.approx(whole.score, rel=2e-5)
    assert joined.score == found[joined.place] == found.max()
    assert joined.place == whole.place or expected[joined.place] == pytest.approx(
        whole.score, rel=2e-5
    )


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(
    ("make", "places", "shards"),
    [
        (unlearned_channel, 61, 2),
        (learned_channel, 97, 4),
        (unlearned_channel, 300, 5),
        (learned_channel, 4500, 2),
    ],
)
def test_shards_of_the_filter_match_every_frame_as_the_whole_does(
    make: Callable[[Array], MapChannel], places: int, shards: int, reverse: bool
) -> None:
    walk = random_walk(places, seed=1)
    config, known = MatchingConfig(), []
    query = a_drive(walk, reverse=reverse)
    for whole, joined in answers(make(walk), "filter", shards, query, reverse=reverse):
        assert_same_beliefs(whole, joined, places)
        expected, found = fuse([whole], config), fuse([joined], config)
        assert (found.place, found.known) == (expected.place, expected.known)
        if expected.probability is not None:
            assert found.probability == pytest.approx(expected.probability, rel=2e-5)
        known.append(found.known)
    assert min(known.count(True), known.count(False)) > 20  # both are put to the test


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(("places", "shards"), [(61, 2), (300, 5)])
def test_shards_of_the_filter_smooth_every_frame_as_the_whole_does(
    places: int, shards: int, reverse: bool
) -> None:
    walk = random_walk(places, seed=1)
    channel = unlearned_channel(walk)
    whole = whole_channel(channel, "filter", reverse=reverse)
    parts = Shards(channel, "filter", shards, reverse=reverse)
    metrics = [channel.metric, *(part.metric for part in parts.parts)]
    compare = [MetricPlaces(metric, exact=True) for metric in metrics]
    expected = []
    for descriptor in a_drive(walk, reverse=reverse):
        frame, *frames = [
            None if descriptor is None else next(each.compare(descriptor[None])) for each in compare
        ]
        whole.update(frame)
        expected += whole.smoothed()
        parts.update(frames)
    expected += whole.finish()
    for one, other in zip(expected, parts.finish(), strict=True):
        assert one.lag == other.lag
        assert_same_beliefs(one.candidate, other.candidate, places)
    assert {each.lag for each in expected} > {0, 20}


FORKED = {
    "first": [0, 100, 150, 156],
    "links": [(59, 100), (99, 100), (149, 20), (149, 150), (155, 156), (199, 0), (170, 172)],
}
"""Four routes with forks, joins and circuits; shards end in the middle of chains."""


@pytest.mark.parametrize("metres", [False, True])
@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("shards", [3, 7])
def test_shards_follow_the_links_of_a_map_as_the_whole_does(
    shards: int, reverse: bool, metres: bool
) -> None:
    walk = random_walk(200, seed=1)
    travelled = np.cumsum(np.random.default_rng(2).uniform(0, 2, 200)) if metres else []
    topology = network(200, **FORKED, travelled=travelled)  # type: ignore[arg-type]
    channel, matching = channel_of(identity_metric(walk)), MatchingConfig(reverse=reverse)
    steps = steps_along(channel.metric.places, channel.metric.unit, topology.graph)
    channel = replace(channel, metric=replace(channel.metric, steps=steps))
    parts = [
        ChannelShard(channel, matching, *of, topology=topology)
        for of in ((0, 1), *((shard, shards) for shard in range(shards)))
    ]
    whole, *matchers = (part.new_matcher() for part in parts)
    way = [*range(40, 60), *range(100, 150), *range(150, 200), *range(30), *range(20, 80)]
    noise = 0.3 * np.random.default_rng(3).normal(size=(len(way), DIMENSIONS)) / DIMENSIONS**0.5
    observed = (walk[way[::-1] if reverse else way] + noise).astype(np.float32)
    observed /= np.linalg.norm(observed, axis=1, keepdims=True)
    places = [MetricPlaces(part.metric, exact=True) for part in parts]
    known = 0

    def assert_alike(one: Candidate, joined_one: Candidate) -> None:
        if metres:  # by odometry, beliefs of other shards come without the negligible ones
            expected, found = beliefs_of(one, 200), beliefs_of(joined_one, 200)
            np.testing.assert_allclose(found, expected, atol=1e-4)
        else:
            assert_same_beliefs(one, joined_one, 200)

    for number, frame in enumerate(observed):
        compared, *each = (next(some.compare(frame[None])) for some in places)
        expected = whole.update(compared, float(number))
        partials = [
            matcher.local(one, float(number)) for matcher, one in zip(matchers, each, strict=True)
        ]
        found = join_shards([matcher.reduce(partials) for matcher in matchers], "filter")
        assert_alike(expected, found)
        known += bool(fuse([found], matching, vicinity_of(topology, 3)).known)
    assert known > len(way) / 2
    for one, *others in zip(whole.finish(), *(each.finish() for each in matchers), strict=True):
        joined_one = join_shards([other.candidate for other in others], "filter")
        assert_alike(one.candidate, joined_one)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(
    ("make", "places", "shards"),
    [(learned_channel, 61, 2), (unlearned_channel, 97, 4), (learned_channel, 150, 5)],
)
def test_shards_that_compare_windows_match_every_frame_as_the_whole_does(
    make: Callable[[Array], MapChannel], places: int, shards: int, reverse: bool
) -> None:
    walk = random_walk(places, seed=1)
    query = a_drive(walk, reverse=reverse)
    for whole, joined in answers(make(walk), "ams", shards, query, reverse=reverse):
        assert (joined.place, joined.score) == (whole.place, whole.score)
    for whole, joined in answers(make(walk), "evidence", shards, query, reverse=reverse):
        assert joined.place == whole.place
        assert joined.score == pytest.approx(whole.score, rel=1e-12)
        np.testing.assert_allclose(joined.evidence, whole.evidence, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(("places", "shards", "lag"), [(61, 2, 20), (97, 4, 5), (150, 5, 20)])
@pytest.mark.parametrize("rule", ["evidence", "ams"])
def test_shards_that_compare_windows_smooth_every_frame_as_the_whole_does(
    rule: Rule, places: int, shards: int, lag: int, reverse: bool
) -> None:
    walk = random_walk(places, seed=1)
    channel = learned_channel(walk)
    query = a_drive(walk, reverse=reverse)
    matching = MatchingConfig(rule=rule, reverse=reverse, lag=lag)
    smoothed = []
    for count in (1, shards):
        parts = [ChannelShard(channel, matching, shard, count) for shard in range(count)]
        matchers = [part.new_matcher() for part in parts]
        compares = [MetricPlaces(part.metric, exact=True) for part in parts]
        frames = []
        for descriptor in [*query, *[None] * matchers[0].tail]:
            partials = [
                matcher.local(
                    None if descriptor is None else next(compare.compare(descriptor[None]))
                )
                for matcher, compare in zip(matchers, compares, strict=True)
            ]
            for matcher in matchers:
                matcher.reduce(partials)
            for each in zip(*[matcher.smoothed() for matcher in matchers], strict=True):
                frames.append(join_shards([one.candidate for one in each], rule))
        smoothed.append(frames)
        assert not any(matcher.finish() for matcher in matchers)
    assert len(smoothed[0]) == len(smoothed[1]) == len(query)
    rel = 1e-12 if rule == "evidence" else 0
    for whole, joined in zip(*smoothed, strict=True):
        assert joined.place == whole.place
        assert joined.score == pytest.approx(whole.score, rel=rel, abs=0)
        np.testing.assert_allclose(joined.evidence, whole.evidence, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("scales", [[5], [2, 3], SCALES])
def test_one_shard_is_the_whole_in_maps_of_any_size(rule: Rule, scales: list[int]) -> None:
    for places in (1, 2, 40):
        walk = random_walk(places, seed=1)
        channel = channel_of(identity_metric(walk), scales)
        for whole, joined in answers(channel, rule, 1, a_drive(walk, reverse=False)):
            assert joined.place == whole.place
            assert joined.score == pytest.approx(whole.score, rel=1e-6)
            assert joined.places.tolist() == whole.places.tolist()
            np.testing.assert_allclose(joined.evidence, whole.evidence, rtol=1e-5)


small_maps = st.lists(
    st.lists(st.integers(-6, 6), min_size=3, max_size=3), min_size=64, max_size=70
)
small_queries = st.lists(
    st.lists(st.integers(-6, 6), min_size=3, max_size=3) | st.sampled_from(["unobserved", "again"]),
    max_size=12,
)


def beside(metric: MapMetric, descriptor: Quantized | None) -> Comparison | None:
    return None if descriptor is None else comparison(metric, descriptor)


@given(small_maps, st.integers(1, 4), small_queries, st.booleans())
@settings(max_examples=50)
def test_shards_of_the_filter_have_the_beliefs_of_the_whole(
    places: list[list[int]], shards: int, query: list[list[int] | str], reverse: bool
) -> None:
    """In maps whose places may coincide, on frames that may be anything."""
    channel = channel_of(metric_of_quantized(np.array(places, np.int16), 0.25), [2])
    whole = whole_channel(channel, "filter", reverse=reverse)
    parts = Shards(channel, "filter", shards, reverse=reverse)
    last: Quantized | None = None
    for frame in query:
        last = np.array(frame, np.int16) if isinstance(frame, list) else last
        descriptor = None if frame == "unobserved" else last
        expected = whole.update(beside(channel.metric, descriptor))
        found = parts.update([beside(part.metric, descriptor) for part in parts.parts])
        assert_same_beliefs(expected, found, len(places))


@pytest.mark.parametrize("reverse", [False, True])
def test_shards_follow_odometry_as_the_whole_does_over_any_distance(reverse: bool) -> None:
    places, rng = random_walk(400, seed=1), np.random.default_rng(2)
    channel, matching = channel_of(identity_metric(places)), MatchingConfig(reverse=reverse)
    travelled = np.cumsum(rng.uniform(0, 2, 400))
    made = [
        [
            ChannelShard(channel, matching, shard, of, topology=topology_of(travelled))
            for shard in range(of)
        ]
        for of in (1, 4)
    ]
    (whole,), parts = ([shard.new_matcher() for shard in shards] for shards in made)
    steps = rng.choice([0, 1, 1, 2, 3, 40, 110], 60, p=[0.1, 0.3, 0.2, 0.2, 0.1, 0.05, 0.05])
    travelled_positions = np.minimum(np.cumsum(steps), 399)
    at, right = 399 - travelled_positions if reverse else travelled_positions, 0
    for number, place in enumerate(at.tolist()):
        frame = places[place] + 0.05 * rng.normal(size=DIMENSIONS).astype(np.float32)
        frame /= np.linalg.norm(frame)
        way = travelled[-1] - travelled[place] if reverse else travelled[place]
        reading = None if number % 7 == 3 else float(way)
        expected = whole.update(beside_all(channel.metric, frame), reading)
        partials = [
            matcher.local(beside_all(shard.metric, frame), reading)
            for matcher, shard in zip(parts, made[1], strict=True)
        ]
        found = join_shards([matcher.reduce(partials) for matcher in parts], "filter")
        assert_same_beliefs(expected, found, 400)
        right += abs(found.place - place) <= 1
    assert right >= 50


def beside_all(metric: MapMetric, frame: Array) -> Comparison:
    return next(MetricPlaces(metric, exact=True).compare(frame[None]))


def test_an_outstanding_place_in_one_shard_leaves_next_to_nothing_to_the_others() -> None:
    """Which are so far from it that float32 has no number for the likelihood there."""
    count, axes = 40_000, np.eye(DIMENSIONS)
    walk = axes[0] + 0.001 * np.random.default_rng(1).normal(size=(count, DIMENSIONS))
    outstanding = [7, 8, 9_999, 10_000, 30_000, 30_001]
    walk[outstanding] = axes[1 : 1 + len(outstanding)]
    walk /= np.linalg.norm(walk, axis=1, keepdims=True)
    channel = channel_of(identity_metric(walk.astype(np.float32)))
    query = list(axes[1 : 1 + len(outstanding)].astype(np.float32))
    pairs = list(answers(channel, "filter", 4, query))
    for whole, joined in pairs:
        assert_same_beliefs(whole, joined, count)
    places = [joined.place for _, joined in pairs]
    assert (
        places[:2] + places[3:] == outstanding[:2] + outstanding[3:]
    )  # a jump is not trusted at once


def test_places_that_are_all_alike_are_as_likely_as_in_the_whole() -> None:
    places = np.repeat(random_walk(1, seed=1), 50, axis=0)
    query = [*random_walk(20, seed=2), None, *random_walk(5, seed=3)]
    for whole, joined in answers(channel_of(identity_metric(places)), "filter", 3, query):
        assert_same_beliefs(whole, joined, 50)


def test_with_a_coarse_search_shards_nearly_agree_with_the_whole() -> None:
    dimensions, count = 96, 6000
    rng = np.random.default_rng(1)
    walk = np.sin(np.cumsum(0.3 * rng.normal(size=(count, dimensions)), axis=0))
    walk /= np.linalg.norm(walk, axis=1, keepdims=True)
    travelled_positions = np.concatenate([np.arange(1950, 2060), np.arange(3980, 4060, 2)])
    query = walk[travelled_positions] + 0.05 * rng.normal(
        size=(len(travelled_positions), dimensions)
    )
    query /= np.linalg.norm(query, axis=1, keepdims=True)
    channel = channel_of(identity_metric(walk.astype(np.float32), coarse=True))
    assert channel.metric.coarse is not None
    frames = list(query.astype(np.float32))
    pairs = list(answers(channel, "filter", 3, frames, exact=False))
    same = [whole.place == joined.place for whole, joined in pairs]
    assert np.mean(same) > 0.97
    for whole, joined in pairs:
        assert joined.score == pytest.approx(whole.score, abs=0.05)


@pytest.mark.parametrize("rule", RULES)
def test_partial_results_are_small(rule: Rule) -> None:
    """Of the filter, a few hundred bytes for each place of the trace."""
    scales = list(range(3, 33))
    walk = random_walk(200, seed=1)
    parts = Shards(channel_of(identity_metric(walk), scales), rule, 4)
    sizes = []
    for number, descriptor in enumerate(walk[:40]):
        observed = number not in (0, 7)
        parts.update(
            [
                next(MetricPlaces(part.metric, exact=True).compare(descriptor[None]))
                if observed
                else None
                for part in parts.parts
            ]
        )
        assert all(partial.dtype == np.float64 for partial in parts.partials)
        sizes.append(sum(partial.nbytes for partial in parts.partials))
    assert max(sizes) < (4 * 5000 + 200 * 300 if rule == "filter" else 4 * 1500)


@given(st.integers(1, 10**6), st.integers(1, 30), st.integers(1, 100))
def test_shards_are_all_places_in_turn_and_about_as_many(
    places: int, shards: int, least: int
) -> None:
    if shards > 1 and places // shards < least:
        with pytest.raises(ConfigError, match=f"take {max(places // least, 1)} at most"):
            shard_range(places, 0, shards, least)
        return
    cut = [shard_range(places, shard, shards, least) for shard in range(shards)]
    assert [cut[0].start, *(part.stop for part in cut)] == [*(part.start for part in cut), places]
    sizes = [part.stop - part.start for part in cut]
    assert max(sizes) - min(sizes) <= 1
    assert shards == 1 or min(sizes) >= least


@pytest.mark.parametrize("shard", [-1, 3])
def test_there_are_no_other_shards(shard: int) -> None:
    with pytest.raises(ConfigError, match="from 0 to 2"):
        shard_range(100, shard, 3, 5)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("reverse", [False, True])
def test_a_shard_is_as_long_as_the_longest_scale_or_step(rule: Rule, reverse: bool) -> None:
    least = 12
    channel = channel_of(identity_metric(random_walk(2 * least + 1, seed=1)))
    matching = MatchingConfig(rule=rule, reverse=reverse)
    shards = [ChannelShard(channel, matching, shard, 2) for shard in (0, 1)]
    assert [shard.own for shard in shards] == [slice(0, least), slice(least, 2 * least + 1)]
    with pytest.raises(ConfigError, match=f"each needs {least}"):
        ChannelShard(channel, matching, 0, 3)
