"""Uniform frames: they are the same as missing observations."""

from pathlib import Path

import numpy as np
import pytest

from placefield.config import Config, MatchingConfig, Rule
from placefield.features.extract import feature_of
from placefield.features.kinds import FeatureKind
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.recognizer import Recognizer

UNREADABLE = b"no image"


def matches(placemap: Map, rule: Rule, frames: list[bytes | np.ndarray]) -> list[Match]:
    recognizer = Recognizer(placemap, Config(matching=MatchingConfig(rule=rule)))
    return [recognizer.update(frame) for frame in frames]


@pytest.mark.parametrize("rule", ["filter", "evidence", "ams"])
@pytest.mark.parametrize("level", [0, 16, 255])
def test_a_uniform_image_is_the_same_as_an_unreadable_one(
    route_map: Map, query_dir: Path, rule: Rule, level: int
) -> None:
    frames: list[bytes | np.ndarray] = [file.read_bytes() for file in sorted(query_dir.iterdir())]
    uniform = np.full((120, 160, 3), level, np.uint8)
    covered = [*frames[:20], *[uniform] * 15, *frames[35:]]
    unobserved = [*frames[:20], *[UNREADABLE] * 15, *frames[35:]]
    assert matches(route_map, rule, covered) == matches(route_map, rule, unobserved)


def test_a_descriptor_of_length_0_is_a_missing_observation(route_map: Map) -> None:
    dimensions = len(route_map.model.components)
    first, second = Recognizer(route_map), Recognizer(route_map)
    one = np.eye(1, dimensions, dtype=np.float32)[0]
    for descriptor in (one, np.zeros(dimensions, np.float32), one):
        observed = descriptor if descriptor.any() else None
        assert first.update_descriptor(descriptor) == second.update_descriptor(observed)


@pytest.mark.parametrize("kind", ["gist", "grayscale"])
@pytest.mark.parametrize("shape", [(120, 160, 3), (480, 752), (100, 100), (48, 48)])
def test_a_uniform_image_of_any_level_has_no_features(
    kind: FeatureKind, shape: tuple[int, ...]
) -> None:
    feature = feature_of(kind)
    for level in range(0, 256, 5):
        raw = feature.describe(np.full(shape, level, np.uint8))
        assert np.ptp(raw) <= 1e-6 * np.abs(raw).max()
