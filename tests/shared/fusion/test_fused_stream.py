from collections.abc import Callable
from typing import get_args

import pytest

from placefield.config import Config, MatchingConfig, Rule
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.recognizer import Recognizer


@pytest.mark.parametrize("rule", get_args(Rule))
def test_a_stream_of_several_lags_matches_as_streams_of_one_lag(
    small_map: Map, make_traverse: Callable[..., Traverse], rule: Rule
) -> None:
    descriptors = [*small_map.model.of_reference(make_traverse(noise=0.3).raw)]
    unobserved = {0, 20, 21}
    stage = ChannelStage(dict(enumerate(small_map.channels)), MatchingConfig(rule=rule))
    fusion = FusionStage(small_map.topology, MatchingConfig(rule=rule))
    lags = (3, 0, 20, 1000)
    stream = FusedStream(stage, fusion, lags)
    causal: list[Match] = []
    smoothed: list[list[SmoothedMatch]] = [[] for _ in lags]
    for frame, descriptor in enumerate(descriptors):
        compared = None if frame in unobserved else next(stage.compare([descriptor]))
        causal.append(stream.update(compared))
        for which, frames in enumerate(smoothed):
            frames += stream.smoothed(which)
    stream.finish()
    for which, frames in enumerate(smoothed):
        frames += stream.smoothed(which)
    for lag, frames in zip(lags, smoothed, strict=True):
        recognizer = Recognizer(small_map, Config(matching=MatchingConfig(rule=rule, lag=lag)))
        alone = [
            recognizer.update_descriptor(None if frame in unobserved else descriptor)
            for frame, descriptor in enumerate(descriptors)
        ]
        assert causal == alone
        assert frames == recognizer.finish()


def test_of_a_whole_drive_nothing_is_smoothed_before_its_end(
    small_map: Map, make_traverse: Callable[..., Traverse]
) -> None:
    stage = ChannelStage(dict(enumerate(small_map.channels)), MatchingConfig())
    stream = FusedStream(stage, FusionStage(small_map.topology, MatchingConfig()), [WHOLE_DRIVE])
    query = [*small_map.model.of_reference(make_traverse(noise=0.3).raw)]
    for compared in stage.compare(query):
        stream.update(compared)
        assert stream.smoothed() == []
    stream.finish()
    smoothed = stream.smoothed()
    assert [each.frame for each in smoothed] == [*range(len(query))]
    assert [each.lag for each in smoothed] == [*range(len(query) - 1, -1, -1)]
    stream.finish()
    assert stream.smoothed() == []
