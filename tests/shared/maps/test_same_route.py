"""Traverses of another route are refused, and those of the same, by night too, are not."""

from pathlib import Path

import numpy as np
import pytest

from placefield.errors import MapError
from placefield.features.extract import feature_of
from placefield.features.frames import Frame
from placefield.maps.same_route import check_same_route
from placefield.maps.traverse import Traverse, describe_frame, traverse_of

DAY, NIGHT = "gardens_point/day_left", "gardens_point/night_right"


def traverse(folder: Path, kind: str, frames: slice = slice(None)) -> Traverse:
    feature = feature_of(kind)
    images = [file.read_bytes() for file in sorted(folder.iterdir())[frames]]
    shown = (Frame(at, at, "", image) for at, image in enumerate(images))
    return traverse_of(str(folder), [describe_frame(frame, feature) for frame in shown])


@pytest.mark.parametrize("kind", ["gist", "grayscale"])
@pytest.mark.parametrize(
    ("one", "other"), [(DAY, NIGHT), ("corridor/ref", "corridor/query")], ids=["night", "corridor"]
)
def test_real_traverses_of_one_route_pass(data_dir: Path, one: str, other: str, kind: str) -> None:
    frames = slice(0, 100)
    check_same_route([traverse(data_dir / each, kind, frames) for each in (one, other)], kind)


@pytest.mark.parametrize("kind", ["gist", "grayscale"])
@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((DAY, slice(0, 40)), (DAY, slice(40, 80))),
        ((DAY, slice(0, 100)), (NIGHT, slice(100, 200))),
        ((DAY, slice(0, 111)), ("corridor/ref", slice(0, 111))),
        (("nordland/summer", slice(0, 200)), ("nordland/winter", slice(600, 800))),
    ],
    ids=["next part", "next part at night", "corridor", "railway"],
)
def test_a_traverse_of_another_route_is_refused_with_how_much_was_recognised(
    data_dir: Path, one: tuple[str, slice], other: tuple[str, slice], kind: str
) -> None:
    first, second = (traverse(data_dir / name, kind, part) for name, part in (one, other))
    with pytest.raises(MapError, match=r"does not show the route of .* \d+% of its frames") as said:
        check_same_route([first, second], kind)
    assert str(said.value).startswith(second.name)
    assert "\n" not in str(said.value)


def test_of_traverses_too_short_for_reporting_it_is_said(
    reference_dir: Path, caplog: pytest.LogCaptureFixture
) -> None:
    parts = [traverse(reference_dir, "gist", part) for part in (slice(0, 20), slice(30, 50))]
    check_same_route(parts, "gist")
    assert "too short to decide" in caplog.text


def test_the_same_frames_again_are_the_same_route(reference_dir: Path) -> None:
    again = traverse(reference_dir, "gist")
    check_same_route([again, again, again], "gist")
    assert len(np.unique(again.stamps)) == 60
