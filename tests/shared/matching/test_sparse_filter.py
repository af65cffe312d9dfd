"""The filter of a large map, beside that of all places."""

import tracemalloc
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from filters import channel_of, posterior_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from route_networks import network, networks

from placefield.config import MatchingConfig
from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import identity_metric, steps_along, with_looks
from placefield.maps.topology import Topology
from placefield.matching.best_window import best_window, vicinity_of
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield.matching.comparing import MetricPlaces
from placefield.matching.matcher import SmoothedCandidate
from placefield.matching.sharding import ChannelShard

Array = NDArray[np.float32]
Reading = float | None

DEFAULT = MatchingConfig()
COUNT, DIMENSIONS = 4000, 32  # of a map of which few places are kept, and few proposed


def walk(count: int, dimensions: int = DIMENSIONS) -> Array:
    """Descriptors of length 1, each near the one before it."""
    rng = np.random.default_rng(count)
    made = np.zeros((count, dimensions))
    for place in range(count):
        made[place] = 0.9 * made[place - 1] + 0.43 * rng.normal(size=dimensions)
    return unit_length(made)


def unit_length(vectors: NDArray[np.floating]) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), np.float32)


def observed(frames: Array, noise: float) -> Array:
    """Of length 1, in another light."""
    rng = np.random.default_rng(5)
    return unit_length(frames + noise / frames.shape[1] ** 0.5 * rng.normal(size=frames.shape))


def metric_on(topology: Topology, places: Array) -> MapMetric:
    metric = identity_metric(places, coarse=True)
    return replace(metric, steps=steps_along(metric.places, metric.unit, topology.graph))


class Answers:
    """The candidates of a drive, at once and smoothed."""

    def __init__(
        self,
        metric: MapMetric,
        topology: Topology,
        frames: Sequence[Array | None],
        readings: Sequence[Reading] = (),
        matching: MatchingConfig = DEFAULT,
    ) -> None:
        shard = ChannelShard(channel_of(metric), matching, topology=topology)
        matcher, places = shard.new_matcher(), MetricPlaces(metric, exact=matching.exact)
        self.at_once: list[Candidate] = []
        self.smoothed: list[SmoothedCandidate] = []
        for frame, reading in zip(frames, readings or [None] * len(frames), strict=True):
            one = None if frame is None else next(places.compare(frame[None]))
            self.at_once.append(matcher.update(one, reading))
            self.smoothed += matcher.smoothed()
        self.smoothed += matcher.finish()


def both(
    metric: MapMetric,
    topology: Topology,
    frames: Sequence[Array | None],
    readings: Sequence[Reading] = (),
    *,
    reverse: bool = False,
) -> tuple[Answers, Answers]:
    """The answers of the filter of few places, and of that of all."""
    few, every = (
        Answers(
            metric, topology, frames, readings, MatchingConfig(exact=exact, lag=8, reverse=reverse)
        )
        for exact in (False, True)
    )
    return few, every


def assert_the_same_beliefs(few: Answers, every: Answers, count: int, tolerance: float) -> None:
    assert len(few.smoothed) == len(every.smoothed)
    pairs = list(zip(few.at_once, every.at_once, strict=True))
    for one, other in zip(few.smoothed, every.smoothed, strict=True):
        assert one.lag == other.lag
        pairs.append((one.candidate, other.candidate))
    for one, other in pairs:
        assert (one.place == UNANSWERED) == (other.place == UNANSWERED)
        difference = posterior_of(one, count) - posterior_of(other, count)
        assert np.abs(difference).max() < tolerance
        assert one.too_fast == pytest.approx(other.too_fast, abs=max(2 * tolerance, 1e-3))


@given(st.integers(2, 150), st.booleans(), st.booleans(), st.data())
@settings(max_examples=10, deadline=None)
def test_where_all_places_are_kept_the_beliefs_are_those_of_the_filter_of_all(
    count: int, knows_metres: bool, reverse: bool, data: st.DataObject
) -> None:
    """On any network of routes, with and without odometry, with missing and repeated frames."""
    topology = data.draw(networks(count))
    rng = np.random.default_rng(count)
    if knows_metres:
        topology = replace(topology, travelled=np.cumsum(rng.choice([0.2, 1, 1, 2], count)))
    metric = metric_on(topology, walk(count))
    drive = [*range(min(count, 10)), *rng.integers(0, count, 6).tolist(), *range(count - 2, -1, -1)]
    frames: list[Array | None] = [*observed(walk(count)[drive[:25]], 0.5)]
    frames[4], frames[7] = frames[3], None
    readings = np.cumsum(rng.choice([0.0, 0.5, 1.0, 3.0, 40.0], len(frames))).tolist()
    few, every = both(metric, topology, frames, readings, reverse=reverse)
    assert_the_same_beliefs(few, every, count, 2e-4)


FORWARD = np.arange(1000, 1040)
OTHER = observed(np.random.default_rng(9).normal(size=(25, DIMENSIONS)).astype(np.float32), 0.1)
DRIVES = {
    "along": [FORWARD],
    "fast": [FORWARD[0] + 4 * np.arange(40)],
    "kidnapped": [FORWARD[:25], np.arange(3000, 3030)],
    "backwards": [FORWARD[::-1]],
    "stationary": [FORWARD[:15], np.repeat(FORWARD[15], 20), FORWARD[16:]],
    "off the route": [FORWARD[:20], None, FORWARD[20:]],
    "over the end": [np.arange(COUNT - 20, COUNT), np.repeat(COUNT - 1, 15)],
}


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("name", DRIVES)
def test_where_few_places_are_kept_the_answers_are_those_of_the_filter_of_all(
    name: str, reverse: bool, missing: bool
) -> None:
    places, topology = walk(COUNT), Topology.line(COUNT)
    stretches = [OTHER if part is None else places[part] for part in DRIVES[name]]
    frames: list[Array | None] = [*observed(np.concatenate(stretches), 0.6)]
    if missing:
        frames[10:14] = [None] * 4
    few, every = both(metric_on(topology, places), topology, frames, reverse=reverse)
    assert_the_same_beliefs(few, every, COUNT, 0.1)
    middles, near = [], vicinity_of(topology, 3)
    for one, other in zip(few.at_once, every.at_once, strict=True):
        (place, _), (expected, sure) = (
            best_window(each.places, each.evidence, near) for each in (one, other)
        )
        if sure > 0.5:
            middles.append(abs(place - expected))
    assert len(middles) == 0 or max(middles) <= 1


def test_a_vehicle_on_a_network_with_odometry_is_where_the_filter_of_all_finds_it() -> None:
    """It takes the second of two ways at a fork, then stands, then slips."""
    travelled = np.concatenate([np.arange(0.0, 3000), np.arange(0.0, 1000)])
    fork = network(COUNT, [0, 3000], [(1019, 3000)], travelled.tolist())
    drive = [*range(1000, 1020), *range(3000, 3020), *[3019] * 5, *range(3020, 3030)]
    readings: list[Reading] = [float(step) for step in range(40)]
    readings += [39.0] * 5 + [45.0 + step for step in range(10)]
    readings[12] = None
    places = walk(COUNT)
    frames: list[Array | None] = [*observed(places[drive], 0.6)]
    few, every = both(metric_on(fork, places), fork, frames, readings)
    assert_the_same_beliefs(few, every, COUNT, 0.02)
    assert [each.place for each in few.at_once[5:]] == [each.place for each in every.at_once[5:]]


def test_looks_of_places_are_compared_as_well() -> None:
    """By night no place resembles its own descriptor, but its look."""
    topology, places = Topology.line(COUNT), walk(COUNT)
    night = walk(COUNT + 1)[1:]
    shown = np.arange(900, 1100, dtype=np.int32)
    looks = identity_metric(night[shown]).places
    metric = with_looks(metric_on(topology, places), shown, looks)
    frames: list[Array | None] = [*observed(night[FORWARD], 0.4)]
    few, every = both(metric, topology, frames)
    assert_the_same_beliefs(few, every, COUNT, 0.02)
    assert [each.place for each in few.at_once[3:]] == FORWARD[3:].tolist()


def test_a_frame_in_a_batch_is_answered_as_alone_to_the_last_bit() -> None:
    topology, places = Topology.line(COUNT), walk(COUNT)
    metric = metric_on(topology, places)
    frames = observed(places[FORWARD], 0.6)
    matcher = ChannelShard(channel_of(metric), MatchingConfig(), topology=topology).new_matcher()
    together = [matcher.update(one) for one in MetricPlaces(metric, exact=False).compare(frames)]
    alone = Answers(metric, topology, [*frames]).at_once
    for one, other in zip(together, alone, strict=True):
        assert (one.place, one.score) == (other.place, other.score)
        np.testing.assert_array_equal(one.places, other.places)
        np.testing.assert_array_equal(one.evidence, other.evidence)


def test_all_places_alike_have_an_answer() -> None:
    metric = identity_metric(np.repeat(walk(1), 3000, axis=0), coarse=True)
    frames: list[Array | None] = [*walk(5), None, *walk(2)]
    answers = Answers(metric, Topology.line(3000), frames).at_once
    for candidate in answers:
        assert 0 <= candidate.place < 3000
        assert 0 <= candidate.score <= 1


def test_a_vehicle_that_nobody_saw_for_long_may_be_anywhere() -> None:
    topology, places = Topology.line(COUNT), walk(COUNT)
    frames: list[Array | None] = [*observed(places[FORWARD[:10]], 0.5), *[None] * 60]
    frames += [*observed(places[3000:3010], 0.5)]
    few, every = both(metric_on(topology, places), topology, frames)
    assert_the_same_beliefs(few, every, COUNT, 0.02)
    assert few.at_once[-1].place == 3009


def test_a_frame_takes_no_memory_for_places_that_are_not_active() -> None:
    """The filter of all places has 144 bytes for each."""
    count, topology = 100_000, Topology.line(100_000)
    places = unit_length(np.random.default_rng(1).normal(size=(count, 8)))
    metric = identity_metric(places, coarse=True)
    shard = ChannelShard(channel_of(metric), MatchingConfig(), topology=topology)
    matcher, compare = shard.new_matcher(), MetricPlaces(metric, exact=False).compare
    for frame in compare(places[:30]):
        matcher.update(frame)
    tracemalloc.start()
    for frame in compare(places[30:60]):
        matcher.update(frame)
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 2e6
    assert peak < 40 * count
