"""A reference that drives a route more than once, from the build to matches."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from placefield.config import Config, MatchingConfig
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match
from placefield.fusion.shard_joiner import join_shards
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse
from placefield.matching.channel_stage import ChannelStage
from placefield.recognizer import Recognizer

PLACES = 90


@pytest.fixture(scope="module")
def map_of_laps(
    make_map: Callable[[Traverse], Map], make_traverse: Callable[..., Traverse]
) -> Callable[[int], Map]:
    """Maps of so many laps of one route, each with noise of its own."""

    def make(laps: int) -> Map:
        whole = make_traverse(PLACES * laps)
        noise = np.random.default_rng(3).normal(scale=0.3, size=whole.raw.shape)
        raw = np.tile(make_traverse(PLACES).raw, (laps, 1)) + noise
        return make_map(replace(whole, raw=raw.astype(np.float32)))

    return make


def matches_of(placemap: Map, query: Traverse, *, reverse: bool = False) -> list[list[Match]]:
    """Matches at once, and smoothed."""
    recognizer = Recognizer(
        placemap, Config(matching=MatchingConfig(precision=0.95, reverse=reverse))
    )
    raws = query.raw[::-1] if reverse else query.raw
    at_once = [recognizer.update_raw(raw) for raw in raws]
    smoothed = [each.match for each in [*recognizer.smoothed(), *recognizer.finish()]]
    return [matches[::-1] if reverse else matches for matches in (at_once, smoothed)]


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("laps", [2, 3])
def test_a_further_lap_is_known_as_often_as_on_a_map_of_one(
    map_of_laps: Callable[[int], Map],
    make_traverse: Callable[..., Traverse],
    laps: int,
    reverse: bool,
) -> None:
    query = make_traverse(PLACES, noise=0.3)
    single = matches_of(map_of_laps(1), query, reverse=reverse)
    several = matches_of(map_of_laps(laps), query, reverse=reverse)
    for alone, shared in zip(single, several, strict=True):
        known = [bool(match.known) for match in shared]
        assert sum(known) >= 0.9 * sum(bool(match.known) for match in alone)
        for place, match in enumerate(shared):
            assert not match.known or abs(match.place % PLACES - place) <= 3


def test_without_sharing_it_is_hardly_known(
    map_of_laps: Callable[[int], Map], make_traverse: Callable[..., Traverse]
) -> None:
    placemap = map_of_laps(2)
    alone = np.arange(2 * PLACES, dtype=np.int32)
    apart = replace(placemap, places=replace(placemap.places, same=alone))
    query = make_traverse(PLACES, noise=0.3)
    known, unknown = (
        sum(bool(match.known) for match in matches_of(each, query)[0]) for each in (placemap, apart)
    )
    assert unknown < known / 2


def test_shards_share_the_laps_and_smooth_frames_as_the_whole_does(
    map_of_laps: Callable[[int], Map],
) -> None:
    placemap, config = map_of_laps(2), MatchingConfig()
    channels = {0: placemap.channels[0]}
    metric = placemap.channels[0].metric
    whole, *parts = (
        ChannelStage(channels, config, shard, shards, placemap.topology)
        for shard, shards in ((0, 1), (0, 2), (1, 2))
    )
    alone, *streams = (stage.new_stream() for stage in (whole, *parts))
    observed = (metric.unit * metric.places[PLACES:]).astype(np.float32)
    for descriptor in observed / np.linalg.norm(observed, axis=1, keepdims=True):
        alone.update(next(whole.compare([descriptor])))
        partials = [
            stream.local(next(stage.compare([descriptor])), stream.next)[0]
            for stage, stream in zip(parts, streams, strict=True)
        ]
        for stream in streams:
            stream.reduce({0: partials})
    fusion = FusionStage(placemap.topology, config)
    for stream in (alone, *streams):
        stream.finish()
    expected, *shards = (stream.smoothed()[0] for stream in (alone, *streams))
    for (_, one), *rest in zip(expected, *shards, strict=True):
        assert [one.lag] * 2 == [part.lag for _, part in rest]
        joined = join_shards([part.candidate for _, part in rest], "filter")
        assert fusion.fuse([joined]).score == pytest.approx(
            fusion.fuse([one.candidate]).score, rel=1e-3, abs=1e-3
        )
