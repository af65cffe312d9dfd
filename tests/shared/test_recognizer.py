from collections.abc import Callable
from dataclasses import replace
from typing import get_args

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.config import Config, MatchingConfig, Rule
from placefield.errors import FrameError
from placefield.features.extract import feature_of
from placefield.features.frames import Frame
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.maps.build import build_map
from placefield.maps.map import Map
from placefield.maps.map_metrics import learned_metric
from placefield.maps.traverse import Traverse, describe_frame, traverse_of
from placefield.matching.candidate import UNANSWERED
from placefield.matching.comparing import MetricPlaces
from placefield.matching.roads import RouteCells
from placefield.matching.sharding import ChannelShard
from placefield.recognizer import Recognizer

RULES: tuple[Rule, ...] = get_args(Rule)
Raw = NDArray[np.float32] | None


def recognise(placemap: Map, rule: Rule, query: list[Raw]) -> list[Match]:
    recognizer = Recognizer(placemap, Config(matching=MatchingConfig(rule=rule)))
    return [recognizer.update_raw(raw) for raw in query]


@pytest.mark.parametrize("rule", RULES)
def test_a_query_in_other_weather_is_recognised(
    small_map: Map, make_traverse: Callable[..., Traverse], rule: Rule
) -> None:
    query = make_traverse(noise=0.3).raw
    matches = recognise(small_map, rule, [*query])
    warm = {"filter": 15, "evidence": 0, "ams": 20}[rule]
    right = [abs(match.place - frame) <= 2 for frame, match in enumerate(matches)][warm:]
    assert np.mean(right) > 0.9


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("reverse", [False, True])
def test_every_channel_is_matched_under_its_own_metric(
    small_map: Map, make_traverse: Callable[..., Traverse], rule: Rule, reverse: bool
) -> None:
    first, other = small_map.channels
    projection = np.random.default_rng(1).normal(size=(12, 30)).astype(np.float32)
    descriptors = (first.metric.unit * first.metric.places).astype(np.float32)
    channels = (first, replace(other, metric=learned_metric(projection, descriptors)), other)
    config = MatchingConfig(rule=rule, reverse=reverse)
    recognizer = Recognizer(replace(small_map, channels=channels), Config(matching=config))

    matchers = [ChannelShard(channel, config).new_matcher() for channel in channels]
    places = [MetricPlaces(channel.metric, exact=True) for channel in channels]
    for frame, descriptor in enumerate(small_map.model.of_reference(make_traverse(noise=0.3).raw)):
        observed = frame not in (0, 30, 31)
        candidates = [
            matcher.update(next(its.compare(descriptor[None])) if observed else None)
            for matcher, its in zip(matchers, places, strict=True)
        ]
        match = recognizer.update_descriptor(descriptor if observed else None)
        assert match == fuse(candidates, config)


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=15)
@given(st.integers(0, 29), st.integers(0, 99))
def test_later_frames_change_no_match(small_map: Map, rule: Rule, newest: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.uniform(0, 9, (2, 30, 30)).astype(np.float32)
    changed: list[Raw] = [*one[: newest + 1], *other[newest + 1 :]]
    if newest + 2 < len(changed):
        changed[newest + 2] = None
    matches = recognise(small_map, rule, [*one])
    assert recognise(small_map, rule, changed)[: newest + 1] == matches[: newest + 1]


@pytest.mark.parametrize("rule", RULES)
def test_streams_of_one_map_do_not_meddle(
    small_map: Map, make_traverse: Callable[..., Traverse], rule: Rule
) -> None:
    forwards = [*make_traverse(40).raw]
    backwards = forwards[::-1]
    recognizers = [
        Recognizer(small_map, Config(matching=MatchingConfig(rule=rule))) for _ in range(2)
    ]
    matches = [
        [recognizer.update_raw(raw) for recognizer, raw in zip(recognizers, pair, strict=True)]
        for pair in zip(forwards, backwards, strict=True)
    ]
    assert [match for match, _ in matches] == recognise(small_map, rule, forwards)
    assert [match for _, match in matches] == recognise(small_map, rule, backwards)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("wrong", [np.ones(29), np.ones(30), np.full(30, np.nan)])
def test_what_does_not_fit_the_map_is_refused_and_the_stream_goes_on(
    small_map: Map, make_traverse: Callable[..., Traverse], rule: Rule, wrong: NDArray[np.float64]
) -> None:
    query = make_traverse(noise=0.3).raw[:20]
    recognizer = Recognizer(small_map, Config(matching=MatchingConfig(rule=rule)))
    matches = []
    for raw in query:
        with pytest.raises(FrameError):
            recognizer.update_descriptor(wrong.astype(np.float32))
        with pytest.raises(FrameError):
            recognizer.update_raw(wrong[:29].astype(np.float32))
        matches.append(recognizer.update_raw(raw))
    assert matches == recognise(small_map, rule, [*query])


def test_every_way_to_push_a_frame_reports_the_matchers_its_odometry(
    small_map: Map, make_traverse: Callable[..., Traverse], given_odometry: list[float | None]
) -> None:
    recognizer = Recognizer(small_map)
    (raw, *_), nothing = make_traverse().raw, np.full((48, 64), 9, np.uint8)
    recognizer.update(b"no image", 1.0)
    recognizer.update(nothing, 2.0)
    recognizer.update_raw(raw, 3.0)
    recognizer.update_raw(None, 3.0)
    recognizer.update_descriptor(None, 0.0)
    recognizer.update_raw(raw)
    assert given_odometry == [1, 2, 3, 3, 0, None]


def test_matchers_are_reported_the_metres_travelled_that_the_map_has(
    make_map: Callable[[Traverse], Map],
    make_traverse: Callable[..., Traverse],
    given_cells: list[RouteCells | None],
) -> None:
    placemap = make_map(make_traverse(spacing=0.5))
    Recognizer(placemap)
    given = given_cells[-1]
    assert given is not None
    assert np.diff(given.middles).tolist() == [0.5] * (placemap.places.count - 1)


@pytest.mark.parametrize("wrong", [-1.0, -np.inf, np.inf, np.nan])
def test_odometry_that_is_no_distance_is_refused_and_no_frame_is_matched(
    small_map: Map,
    make_traverse: Callable[..., Traverse],
    given_odometry: list[float | None],
    wrong: float,
) -> None:
    query = make_traverse(noise=0.3).raw[:10]
    recognizer = Recognizer(small_map)
    matches = []
    for raw in query:
        for push in (recognizer.update_raw, recognizer.update_descriptor):
            with pytest.raises(FrameError, match="odometry"):
                push(raw, wrong)
        with pytest.raises(FrameError, match="odometry"):
            recognizer.update(b"no image", wrong)
        matches.append(recognizer.update_raw(raw))
    assert len(given_odometry) == len(query)
    assert matches == recognise(small_map, "filter", [*query])


@pytest.mark.parametrize("rule", RULES)
def test_before_the_first_frame_that_is_seen_there_is_no_match(
    small_map: Map, make_traverse: Callable[..., Traverse], rule: Rule
) -> None:
    query = [*make_traverse().raw]
    matches = recognise(small_map, rule, [None] * 30 + query)
    assert all(match == Match(UNANSWERED, 0.0) for match in matches[:30])
    assert matches[30:] == recognise(small_map, rule, query)


def panorama_route(frames: int) -> list[NDArray[np.uint8]]:
    """A view that slides along one long wall."""
    noise = np.random.default_rng(4).integers(0, 256, (64, 96 + 8 * frames), np.uint8)
    wall = np.asarray(cv2.equalizeHist(cv2.GaussianBlur(noise, (0, 0), 5)), np.uint8)
    return [wall[:, 8 * frame : 8 * frame + 96].copy() for frame in range(frames)]


@pytest.mark.parametrize("kind", ["gist", "grayscale"])
def test_images_are_recognised_past_one_that_cannot_be_read(kind: str) -> None:
    views = panorama_route(60)
    config = Config.model_validate(
        {"features": {"kind": kind}, "scales": {"channels": 1}, "metric": {"kind": "identity"}}
    )
    feature = feature_of(kind)
    described = [
        describe_frame(Frame(number, number, "", view), feature)
        for number, view in enumerate(views)
    ]
    placemap = build_map([traverse_of("wall", described)], config)

    dusk = [np.asarray(view * 0.6 + 10, np.uint8) for view in views]
    encoded = [cv2.imencode(".jpg", view)[1].tobytes() for view in dusk]
    encoded[30] = encoded[30][:500]
    recognizer = Recognizer(placemap, config)
    matches = [recognizer.update(image) for image in encoded]
    assert [match.place for match in matches] == pytest.approx(range(60), abs=1)

    by_pixels = Recognizer(placemap, config)
    by_feature = Recognizer(placemap, config)
    for view in dusk:
        raw = feature.describe(view)
        assert by_pixels.update(view) == by_feature.update_raw(raw)
    for wrong in (np.empty((0, 96), np.uint8), dusk[0].astype(np.float32), dusk[0][:, :, None]):
        with pytest.raises(FrameError, match="pixels"):
            by_pixels.update(wrong)
    assert by_pixels.update(dusk[0]) == by_feature.update_raw(feature.describe(dusk[0]))


@pytest.mark.parametrize("rule", RULES)
def test_a_match_has_the_pose_of_its_place_at_once_and_smoothed(
    make_map: Callable[[Traverse], Map], make_traverse: Callable[..., Traverse], rule: Rule
) -> None:
    placemap = make_map(make_traverse(spacing=0.5))
    poses = placemap.places.poses.copy()
    poses[::3] = np.nan
    placemap = replace(placemap, places=replace(placemap.places, poses=poses))
    recognizer = Recognizer(placemap, Config(matching=MatchingConfig(rule=rule)))
    matches = [recognizer.update_raw(raw) for raw in [None, *make_traverse(noise=0.3).raw]]
    matches += [each.match for each in recognizer.smoothed() + recognizer.finish()]
    assert {match.pose is None for match in matches} == {True, False}
    for match in matches:
        known = match.place != UNANSWERED and np.isfinite(poses[match.place]).all()
        assert match.pose == (tuple(poses[match.place]) if known else None)
