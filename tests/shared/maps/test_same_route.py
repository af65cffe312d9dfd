"""Traverses of another route are refused; those of the same route are aligned, also at night."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from placefield.errors import MapError
from placefield.features.extract import feature_of
from placefield.features.frames import Frame
from placefield.maps.same_route import align_traverses
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
    align_traverses([traverse(data_dir / each, kind, frames) for each in (one, other)], kind)


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
        align_traverses([first, second], kind)
    assert str(said.value).startswith(second.name)
    assert "\n" not in str(said.value)


def test_of_traverses_too_short_for_reporting_it_is_said(
    reference_dir: Path, caplog: pytest.LogCaptureFixture
) -> None:
    parts = [traverse(reference_dir, "gist", part) for part in (slice(0, 20), slice(30, 50))]
    align_traverses(parts, "gist")
    assert "too short to decide" in caplog.text


def test_the_same_frames_again_are_the_same_route(reference_dir: Path) -> None:
    again = traverse(reference_dir, "gist")
    for other in align_traverses([again, again, again], "gist")[1:]:
        alignment = other.alignment
        assert alignment is not None
        assert alignment.by == "smoother"
        shown = alignment.places >= 0
        np.testing.assert_array_equal(alignment.places[shown], np.flatnonzero(shown))


def test_a_drive_that_begins_and_ends_off_the_route_is_aligned_on_the_route(
    data_dir: Path,
) -> None:
    first, night = traverse(data_dir / DAY, "gist"), traverse(data_dir / NIGHT, "gist")
    before, after = (traverse(data_dir / "corridor" / each, "gist") for each in ("ref", "query"))
    raw = np.concatenate([before.raw, night.raw[20:180], after.raw])
    drive = replace(night, raw=raw)
    alignment = align_traverses([first, drive], "gist")[1].alignment
    assert alignment is not None
    shown = np.flatnonzero(alignment.places >= 0)
    assert len(shown) > 60
    truth = 20 + shown - len(before.raw)
    assert np.abs(alignment.places[shown] - truth).max() <= 3


def georeferenced(shown: Traverse, metres: np.ndarray, latitude: float) -> Traverse:
    """Return the traverse with poses along a parallel to the east, from their origin on."""
    poses = np.column_stack([metres, np.zeros((len(metres), 2))])
    return replace(shown, poses=poses, pose_frame=f"wgs84 {latitude:.9f} 8.000000000")


def test_georeferenced_poses_decide_whatever_their_origins_are(reference_dir: Path) -> None:
    route = traverse(reference_dir, "gist")
    first = georeferenced(route, np.arange(60) * 2.0, 47)
    north = georeferenced(route, np.arange(60)[::-1] * 2.0, 47.0001)  # 11 m
    north.poses[:, 1] -= 11.1
    alignment = align_traverses([first, north], "gist")[1].alignment
    assert alignment is not None
    assert alignment.by == "poses"
    np.testing.assert_array_equal(alignment.places, np.arange(60)[::-1])


def test_far_or_local_poses_leave_the_alignment_to_the_smoother(reference_dir: Path) -> None:
    route = traverse(reference_dir, "gist")
    first, far = (georeferenced(route, np.arange(60) * 2.0, latitude) for latitude in (47, 48))
    own = replace(far, pose_frame="route")
    for other in (far, own):
        alignment = align_traverses([first, other], "gist")[1].alignment
        assert alignment is not None
        assert alignment.by == "smoother"
