"""Frames compared with places that have looks of other traverses."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from filters import channel_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.config import MatchingConfig, Rule
from placefield.fusion.shard_joiner import join_shards
from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import identity_metric, learned_metric, with_looks
from placefield.matching.comparing import MetricPlaces, SampledPlaces
from placefield.matching.sharding import ChannelShard
from placefield.matching.warm_up import beginning_of
from placefield.search.quantized import DESCRIPTOR_UNIT, Quantized, quantize

Array = NDArray[np.float32]
DIMENSIONS = 40
COUNT = 200
SHOWN = np.sort(np.random.default_rng(5).integers(50, 150, 130)).astype(np.int32)
"""The places of the looks: some have several, and those at both ends have none."""


def unit_vectors(count: int, seed: int) -> Array:
    vectors = np.random.default_rng(seed).normal(size=(count, DIMENSIONS))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), np.float32)


PLACES, OBSERVED = unit_vectors(COUNT, 1), unit_vectors(len(SHOWN), 2)


def metric_with_looks(kind: str, *, coarse: bool = False) -> MapMetric:
    metric = identity_metric(PLACES, coarse=coarse)
    if kind == "learned":
        projection = np.random.default_rng(9).normal(size=(25, DIMENSIONS)).astype(np.float32)
        metric = learned_metric(projection, PLACES, coarse=coarse)
    return with_looks(metric, SHOWN, quantize(OBSERVED, DESCRIPTOR_UNIT))


def naive_distances(metric: MapMetric, descriptor: Quantized) -> NDArray[np.int64]:
    """The least distance to a place and to each of its looks, plus the place's bias."""
    assert metric.looks is not None
    frame = descriptor.astype(np.int64)
    least = [int(((place - frame) ** 2).sum()) for place in metric.places]
    for place, look in zip(SHOWN, metric.looks.descriptors, strict=True):
        least[place] = min(least[place], int(((look - frame) ** 2).sum()))
    return np.array(least) + metric.looks.biases


@pytest.mark.parametrize("kind", ["identity", "learned"])
def test_distances_are_the_least_of_a_place_and_its_looks_plus_its_bias(kind: str) -> None:
    metric = metric_with_looks(kind)
    for frame in MetricPlaces(metric, exact=True).compare(unit_vectors(30, 3)):
        np.testing.assert_array_equal(frame.distances, naive_distances(metric, frame.descriptor))


@pytest.mark.parametrize("kind", ["identity", "learned"])
def test_the_deviation_is_that_without_looks(kind: str) -> None:
    metric, query = metric_with_looks(kind), unit_vectors(5, 3)
    alone = MetricPlaces(replace(metric, looks=None), exact=True).compare(query)
    for frame, other in zip(MetricPlaces(metric, exact=True).compare(query), alone, strict=True):
        assert frame.deviation == other.deviation


def test_a_frame_like_a_look_is_nearest_to_the_place_of_the_look() -> None:
    compared = MetricPlaces(metric_with_looks("identity"), exact=True).compare(OBSERVED)
    assert [int(frame.distances.argmin()) for frame in compared] == SHOWN.tolist()


def test_looks_make_a_place_no_nearer_to_an_average_frame() -> None:
    metric = metric_with_looks("identity")
    assert metric.looks is not None
    frames = MetricPlaces(metric, exact=True).compare(unit_vectors(2000, 4))
    mean = np.mean([frame.distances for frame in frames], axis=0)
    alone = MetricPlaces(replace(metric, looks=None), exact=True).compare(unit_vectors(2000, 4))
    without = np.mean([frame.distances for frame in alone], axis=0)
    looked = np.isin(np.arange(COUNT), SHOWN)
    biases = metric.looks.biases
    np.testing.assert_array_equal(mean[~looked], without[~looked])
    assert (biases[looked] > 0).all()
    assert not biases[~looked].any()
    assert np.abs(mean - without)[looked].mean() < 0.2 * biases[looked].mean()


@pytest.mark.parametrize("kind", ["identity", "learned"])
@given(chosen=st.lists(st.integers(0, COUNT - 1), unique=True, max_size=60).map(sorted))
@settings(max_examples=20)
def test_the_nearest_and_the_chosen_places_are_exact_after_a_coarse_search(
    kind: str, chosen: list[int]
) -> None:
    metric = metric_with_looks(kind, coarse=True)
    assert metric.coarse is not None
    metric = replace(metric, coarse=replace(metric.coarse, lists=None))
    for frame in MetricPlaces(metric, exact=False).compare(OBSERVED[:3]):
        expected = naive_distances(metric, frame.descriptor)
        nearest = int(expected.argmin())
        assert frame.distances[nearest] == expected[nearest]
        ranked = frame.reranked(np.array(chosen, np.int32))
        np.testing.assert_array_equal(ranked.distances[chosen], expected[chosen])
        reverse = COUNT - 1 - np.array(chosen, np.int32)[::-1]
        turned = frame.reversed().reranked(reverse)
        np.testing.assert_array_equal(turned.distances[::-1][chosen], expected[chosen])


def test_sampled_places_have_the_distances_of_all() -> None:
    metric = metric_with_looks("identity")
    chosen = np.array([150, 120, 90, 51, 0], np.int32)
    (frame,) = MetricPlaces(metric, exact=True).compare(unit_vectors(1, 3))
    expected = frame.distances[np.clip(np.add.outer(chosen, (-1, 0, 1)), 0, COUNT - 1)]
    found = SampledPlaces(metric, chosen).distances(frame.descriptor)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("rule", get_args(Rule))
def test_shards_answer_as_the_whole_does(rule: Rule, reverse: bool) -> None:
    metric = metric_with_looks("identity")
    matching = MatchingConfig(rule=rule, reverse=reverse)
    whole = ChannelShard(channel_of(metric), matching)
    parts = [ChannelShard(channel_of(metric), matching, shard, 3) for shard in range(3)]
    matcher, matchers = whole.new_matcher(), [part.new_matcher() for part in parts]
    drive = np.concatenate([PLACES[30:60], OBSERVED[20:100], PLACES[150:170]])
    for descriptor in drive[::-1] if reverse else drive:
        (frame,) = MetricPlaces(whole.metric, exact=True).compare(descriptor[None])
        partials = [
            one.local(next(MetricPlaces(part.metric, exact=True).compare(descriptor[None])))
            for one, part in zip(matchers, parts, strict=True)
        ]
        joined = join_shards([one.reduce(partials) for one in matchers], rule)
        expected = matcher.update(frame)
        assert joined.place == expected.place
        assert joined.score == pytest.approx(expected.score, rel=1e-4)


def test_a_beginning_has_the_looks_of_its_places() -> None:
    metric = metric_with_looks("identity")
    short = beginning_of(channel_of(metric)).metric
    assert metric.looks is not None
    assert short.looks is not None
    assert short.looks.places.tolist() == [place for place in SHOWN if place < 100]
    (frame,) = MetricPlaces(metric, exact=True).compare(unit_vectors(1, 3))
    (first,) = MetricPlaces(short, exact=True).compare(unit_vectors(1, 3))
    np.testing.assert_array_equal(first.distances, frame.distances[:100])
