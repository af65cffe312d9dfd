"""Parts of one drive are one drive, traverses are not, and the line says which."""

import os
import re
from collections.abc import Callable
from pathlib import Path
from shutil import copy

import cv2
import pytest
from test_ros_recording import (
    FIX,
    FORMATS,
    ODOMETRY,
    RATE,
    START_NS,
    Said,
    images,
    jpeg,
    pose,
    record,
)

from placefield.config import Config
from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.sources import NO_PARTS, Parts, open_source
from placefield_tools.sources.drives import drives_of

COUNT = 8
CASES = Path(os.environ.get("PLACEFIELD_CASES") or Path(__file__).parents[4] / "shared" / "cases")

Also = Callable[[float], list[Said]]


def nothing(_: float) -> list[Said]:
    return []


def part(path: Path, begin_s: float, form: str = "ros1", also: Also = nothing) -> str:
    said = [Said("/cam", each.kind, begin_s + each.second, each.fields) for each in images()]
    return record(path, [*said, *also(begin_s)], form)


def frames_of(where: str | tuple[str, ...], parts: Parts = NO_PARTS) -> list[Frame]:
    with open_source(where, parts=parts) as source:
        frames = list(source)
        assert source.count == len(frames)
    return frames


@pytest.mark.parametrize("form", FORMATS)
def test_parts_that_go_on_are_one_drive_in_whatever_order_they_are_given(
    tmp_path: Path, form: str, caplog: pytest.LogCaptureFixture
) -> None:
    one, two, three = (part(tmp_path / f"d_{at}", at * 0.9, form) for at in range(3))
    assert drives_of([three, one, two], NO_PARTS, None) == [(one, two, three)]
    assert "treated as one drive" in caplog.text
    assert "--traverses" in caplog.text
    frames = frames_of((three, one, two))
    assert [frame.index for frame in frames] == list(range(3 * COUNT))
    stamps = [frame.stamp_ns for frame in frames]
    assert stamps == sorted(stamps)
    assert [frame.image for frame in frames] == 3 * [jpeg(at).tobytes() for at in range(COUNT)]


@pytest.mark.parametrize("seconds", [0, -0.3, 3600, -3600])
def test_recordings_that_do_not_go_on_are_traverses(tmp_path: Path, seconds: float) -> None:
    where = [part(tmp_path / "a", 7200), part(tmp_path / "b", 7200 + seconds)]
    assert drives_of(where, NO_PARTS, None) == [(where[0],), (where[1],)]
    if abs(seconds) > 1:
        assert drives_of(where, NO_PARTS, one_drive=True) == [tuple(where)]


@pytest.mark.parametrize(
    ("names", "pause_s", "is_one"),
    [
        (("d_1", "d_2"), 30, True),
        (("d_09", "d_10"), 30, True),
        (("d_1", "d_3"), 30, False),
        (("d_1", "e_2"), 30, False),
        (("d_2", "d_1"), 30, False),
        (("day", "night"), 30, False),
        (("d_1", "d_2"), 90, False),
        (("day", "night"), 4, True),
    ],
)
def test_a_pause_is_longer_between_files_that_are_numbered_on(
    tmp_path: Path, names: tuple[str, str], pause_s: float, is_one: bool
) -> None:
    where = [part(tmp_path / name, at * (0.7 + pause_s)) for at, name in enumerate(names)]
    assert len(drives_of(where, NO_PARTS, None)) == (1 if is_one else 2)


def test_two_split_traverses_are_two_drives_and_the_first_named_is_the_first(
    tmp_path: Path,
) -> None:
    night = [part(tmp_path / f"night_{at}", 9000 + at) for at in range(2)]
    day = [part(tmp_path / f"day_{at}", at) for at in range(2)]
    assert drives_of([*night, *day], NO_PARTS, None) == [tuple(night), tuple(day)]
    each = [(where,) for where in (*night, *day)]
    assert drives_of([*night, *day], NO_PARTS, one_drive=False) == each


@pytest.mark.parametrize("form", FORMATS)
def test_a_folder_of_recordings_is_one_in_order_of_stamps(tmp_path: Path, form: str) -> None:
    folder = tmp_path / "drives"
    folder.mkdir()
    for name, begin in (("b", 0.0), ("c", 1.0), ("a", 2.0)):
        part(folder / name, begin, form)
    frames = frames_of(str(folder))
    assert len(frames) == 3 * COUNT
    assert [frame.name[0] for frame in frames[::COUNT]] == ["b", "c", "a"]
    chosen = frames_of(str(folder), Parts(start=5, stride=7))
    assert [frame.index for frame in chosen] == [5, 12, 19]
    assert [frame.image for frame in chosen] == [frames[at].image for at in (5, 12, 19)]
    with pytest.raises(SourceError, match=r"--start 24: .* holds only 24 frames"):
        open_source(str(folder), parts=Parts(start=24))


def test_a_folder_of_recordings_of_one_time_is_refused(tmp_path: Path) -> None:
    for name in ("left", "right"):
        part(tmp_path / name, 0)
    with pytest.raises(SourceError, match="at the same time"):
        open_source(str(tmp_path))


def test_a_pause_in_one_drive_is_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    part(tmp_path / "a", 0)
    part(tmp_path / "b", 100)
    assert len(frames_of(str(tmp_path))) == 2 * COUNT
    assert re.search(r"99 seconds between parts 1 and 2", caplog.text)


def test_odometry_and_fixes_go_on_from_part_to_part(tmp_path: Path) -> None:
    def odometry(begin: float) -> list[Said]:
        at = [begin + step / RATE for step in range(COUNT)]
        return [Said("/odom", ODOMETRY, s, {"pose": {"pose": pose(s, 0)}}) for s in at]

    def fixes(begin: float) -> list[Said]:
        at = [begin + step / RATE for step in range(COUNT)]
        return [Said("/fix", FIX, s, {"latitude": 47 + s / 1e5, "longitude": 8.0}) for s in at]

    for name, also in (("odometry", odometry), ("fixes", fixes)):
        folder = tmp_path / name
        folder.mkdir()
        parts = tuple(part(folder / f"d_{at}", at * 0.8, "mcap", also) for at in range(2))
        frames = frames_of(parts)
        metres = [frame.odometry_m or 0 for frame in frames]
        along = [frame.pose.x if name == "odometry" else frame.pose.y for frame in frames]  # type: ignore[union-attr]
        assert metres == pytest.approx(along, abs=0.01)
        assert along[-1] == pytest.approx(1.5 if name == "odometry" else 1.5 * 1.11177, rel=1e-3)


def stamped_folder(folder: Path, reference: Path, first: int, end: int) -> str:
    folder.mkdir()
    rows = ["file,stamp,odometry"]
    for at in range(first, end):
        copy(reference / f"{at:04}.jpg", folder)
        rows.append(f"{at:04}.jpg,{1000 + at},{at - first}")
    (folder / "frames.csv").write_text("\n".join(rows))
    return str(folder)


def test_stamped_folders_that_go_on_build_the_map_of_the_whole(
    tmp_path: Path, reference_dir: Path
) -> None:
    where = [stamped_folder(tmp_path / f"{at}", reference_dir, at, at + 20) for at in (20, 0, 40)]
    config = Config.model_validate({"scales": {"channels": 1}, "metric": {"kind": "identity"}})
    built = build_from(where, config)
    assert built.places.count == 60
    assert (built.places.stamps == [(1000 + at) * 10**9 for at in range(60)]).all()
    assert (built.places.travelled[1:] >= built.places.travelled[:-1]).all()


def test_videos_are_joined_as_they_are_given_if_they_are_said_to_be_one_drive(
    tmp_path: Path, reference_dir: Path
) -> None:
    where = []
    for name in ("two", "one"):
        writer = cv2.VideoWriter(
            str(tmp_path / f"{name}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (96, 72)
        )
        for file in sorted(reference_dir.iterdir())[:5]:
            writer.write(cv2.imread(str(file)))
        writer.release()
        where.append(str(tmp_path / f"{name}.avi"))
    assert drives_of(where, NO_PARTS, None) == [(where[0],), (where[1],)]
    (drive,) = drives_of(where, NO_PARTS, one_drive=True)
    frames = frames_of(drive)
    assert [frame.index for frame in frames] == list(range(10))
    assert frames[5].name.startswith("one")


def test_a_split_recording_is_its_whole_drive() -> None:
    drive = CASES / "split_recordings"
    if not drive.is_dir():
        pytest.skip(f"no cases at {CASES}; say where they are with PLACEFIELD_CASES")
    where = [str(file) for file in sorted(drive.glob("*.bag"))]
    assert drives_of(where, Parts(), None) == [tuple(where)]
    stamps = [frame.stamp_ns for frame in frames_of(str(drive))]
    assert len(stamps) == 120
    assert stamps == sorted(stamps)
    assert stamps[0] == START_NS
