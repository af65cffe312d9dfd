from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from placefield.baselines.multiscale import fixed_scale_channels
from placefield.config import Config, MatchingConfig
from placefield.errors import MapError
from placefield.maps.build import build_map
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.maps.traverse import Traverse
from placefield.matching.sharding import window_lengths
from placefield.recognizer import Recognizer

SCALES = (6, 12, 24)


def test_every_scale_has_segments_of_its_length_twice_half_a_segment_apart() -> None:
    channels = fixed_scale_channels(200, (7, 20))
    starts = [channel.encoding.segments[:, 0].tolist() for channel in channels]
    assert starts == [
        list(range(0, 194, 7)),
        list(range(3, 194, 7)),
        list(range(0, 181, 20)),
        list(range(10, 181, 20)),
    ]
    for channel, scale in zip(channels, (7, 7, 20, 20), strict=True):
        assert channel.clusters[0] == 0
        segments = channel.encoding.segments
        assert set(np.diff(segments, axis=1).ravel()) == {scale}
        for number, (first, end) in enumerate(segments.tolist(), 1):
            assert set(channel.encoding.labels[first:end]) == {number}
            assert len(set(channel.clusters[first:end])) == 1


def test_all_but_the_ends_of_the_route_lies_in_segments_of_both_offsets() -> None:
    for scale in (6, 12, 24, 48):
        for channel in fixed_scale_channels(300, (scale,)):
            labels = channel.encoding.labels
            assert labels[scale // 2 : 300 - scale].all()
            assert len(labels) == 300


def test_each_channel_matches_from_its_own_scale_to_the_smallest(fixed_scale_map: Map) -> None:
    lengths = [window_lengths(one, "ams") for one in fixed_scale_map.channels]
    assert lengths == [[6], [6], [6, 12], [6, 12], [6, 24], [6, 24]]


def test_refuses_a_reference_too_short_for_two_segments() -> None:
    with pytest.raises(MapError, match=r"119 frames is too short .* scale 48.* least 120 frames"):
        fixed_scale_channels(119)
    fixed_scale_channels(120)


@pytest.fixture(scope="module")
def fixed_scale_map(make_traverse: Callable[..., Traverse]) -> Map:
    config = Config.model_validate({"metric": {"kind": "identity"}, "scales": {"min_scale": 6}})
    return build_map(
        [make_traverse()],
        config,
        cut=lambda descriptors, *_: fixed_scale_channels(len(descriptors), SCALES),
    )


def test_a_map_of_fixed_scales_recognises_its_route(
    fixed_scale_map: Map, make_traverse: Callable[..., Traverse]
) -> None:
    recognizer = Recognizer(fixed_scale_map, Config(matching=MatchingConfig(rule="ams")))
    matches = [recognizer.update_raw(raw) for raw in make_traverse(noise=0.5).raw]
    before = SCALES[0] - 1
    assert [match.place for match in matches] == [-1] * before + list(range(before, 90))


def test_a_map_of_fixed_scales_is_kept_on_disk(fixed_scale_map: Map, tmp_path: Path) -> None:
    save_map(fixed_scale_map, tmp_path / "fixed.pfmap")
    kept = open_map(tmp_path / "fixed.pfmap").channels
    assert [channel.scales.tolist() for channel in kept] == [
        channel.scales.tolist() for channel in fixed_scale_map.channels
    ]
