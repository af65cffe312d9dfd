"""What a program or a notebook prints of a public object is one short line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from placefield import Config, Describer, Frame, Match, Pose, Recognizer, open_map, save_map
from placefield.features.network import Network, NetworkInput
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse

LONGEST = 240
"""Characters: what a terminal shows in a few lines."""


@pytest.fixture
def objects(route_map: Map, make_traverse: Callable[..., Traverse]) -> list[object]:
    return [
        route_map,
        route_map.places,
        route_map.channels[0],
        route_map.metrics[0],
        route_map.model,
        make_traverse(),
        Network(NetworkInput(width=9, height=9), np.zeros(10**6, np.uint8)),
        Recognizer(route_map),
        Frame(0, 0, "first.jpg", bytes(10**6), Pose(1, 2, 3)),
        Frame(0, 0, "", np.zeros((48, 64, 3), np.uint8)),
        Match(3, 1.5, pose=Pose(1, 2, 3)),
        Describer(),
    ]


def test_a_public_object_is_one_short_line(objects: list[object]) -> None:
    for each in objects:
        assert "\n" not in repr(each)
        assert len(repr(each)) < LONGEST
        assert repr(each).startswith(f"{type(each).__name__}(")


def test_a_configuration_is_one_line() -> None:
    assert "\n" not in repr(Config())


def test_a_map_says_which_it_is_and_how_large(route_map: Map, tmp_path: Path) -> None:
    save_map(route_map, tmp_path / "route.pfmap")
    opened = open_map(tmp_path / "route.pfmap", ())
    for part in (opened.digest, f"{opened.places.count} places", opened.features.kind):
        assert part in repr(opened)


def test_a_recognizer_counts_its_frames(small_map: Map) -> None:
    recognizer = Recognizer(small_map)
    for frames in range(3):
        assert f"after {frames} frames" in repr(recognizer)
        recognizer.update_raw(None)
