from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from placefield.config import Config
from placefield.errors import SourceError
from placefield.features.frames import Pose
from placefield.maps.geography import Origin
from placefield.maps.trajectory import Trajectory
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.sources import Parts, open_source
from placefield_tools.sources.distance_sampled import DistanceSampled
from placefield_tools.sources.folder import Folder
from placefield_tools.sources.with_poses import WithPoses

COUNT = 40
RATE = 10
CONFIG = Config.model_validate({"scales": {"channels": 2}, "metric": {"kind": "identity"}})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    drive = tmp_path / "drive"
    drive.mkdir()
    for at in range(COUNT):
        noise = np.random.default_rng(at // 4).integers(0, 256, (24, 32)).astype(np.uint8)
        cv2.imwrite(str(drive / f"{at:02}.png"), cv2.GaussianBlur(noise, (0, 0), 2))
    return drive


@pytest.fixture
def stamped(folder: Path) -> Path:
    """The same with the stamps that it would be given."""
    rows = [f"{at:02}.png,{at / RATE:.1f}" for at in range(COUNT)]
    (folder / "frames.csv").write_text("\n".join(["file,stamp", *rows]))
    return folder


def tum(path: Path, first: int = 0, last: int = COUNT - 1) -> Path:
    """Poses of the frames of these numbers: 0.5 m apart, to the north."""
    lines = [
        f"{at / RATE:.1f} 1 {at / 2} 0 0 0 {0.5**0.5} {0.5**0.5}" for at in range(first, last + 1)
    ]
    path.write_text("\n".join(lines))
    return path


def kitti(path: Path, count: int) -> Path:
    path.write_text("\n".join(f"1 0 0 0 0 1 0 0 0 0 1 {at}" for at in range(count)))
    return path


def test_a_tum_file_gives_each_frame_its_pose_and_metres(folder: Path, tmp_path: Path) -> None:
    parts = Parts(poses=tum(tmp_path / "poses.txt"))
    frames = list(open_source(str(folder), parts=replace(parts, start=4, stride=10)))
    assert [frame.index for frame in frames] == [4, 14, 24, 34]
    found = [(f.pose.x, f.pose.y, f.pose.yaw, f.odometry_m) for f in frames]
    expected = [(1, at / 2, np.pi / 2, at / 2) for at in (4, 14, 24, 34)]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    spaced = open_source(str(folder), parts=parts, spacing_m=2)
    assert [frame.index for frame in spaced] == list(range(0, COUNT, 4))


def test_frames_outside_of_the_trajectory_are_left_out_and_counted(
    stamped: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    parts = Parts(poses=tum(tmp_path / "poses.txt", 5, 30))
    assert [frame.index for frame in open_source(str(stamped), parts=parts)] == list(range(5, 31))
    assert "poses.txt: 14 of 40 frames" in caplog.text


def test_a_kitti_file_gives_each_frame_its_line(folder: Path, tmp_path: Path) -> None:
    parts = Parts(poses=kitti(tmp_path / "00.txt", COUNT), start=1, stride=7)
    frames = list(open_source(str(folder), parts=parts))
    assert [frame.pose for frame in frames] == [Pose(at, 0, 0) for at in range(1, COUNT, 7)]


@pytest.mark.parametrize("lines", [COUNT - 1, COUNT + 1])
def test_a_kitti_file_of_another_drive_is_refused(folder: Path, tmp_path: Path, lines: int) -> None:
    parts = Parts(poses=kitti(tmp_path / "00.txt", lines))
    with pytest.raises(SourceError, match=f"00.txt: has {lines} lines; .*another number of frames"):
        open_source(str(folder), parts=parts)


@pytest.mark.parametrize(("start", "stride"), [(0, 1), (3, 7), (0, COUNT)])
def test_a_video_of_fewer_frames_than_lines_is_refused_at_its_end(
    tmp_path: Path, start: int, stride: int
) -> None:
    video = write_video(tmp_path / "whole.avi")
    parts = Parts(poses=kitti(tmp_path / "00.txt", COUNT), start=start, stride=stride)
    frames = list(open_source(video, parts=parts))
    assert [frame.pose.x for frame in frames if frame.pose] == [*range(start, COUNT, stride)]
    parts = Parts(poses=kitti(tmp_path / "00.txt", 2 * COUNT), start=start, stride=stride)
    with pytest.raises(SourceError, match=f"has {2 * COUNT} lines"):
        list(open_source(video, parts=parts))


def write_video(path: Path) -> str:
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"MJPG"), RATE, (64, 48)
    )
    for at in range(COUNT):
        writer.write(np.full((48, 64, 3), at, np.uint8))
    writer.release()
    return str(path)


@pytest.fixture
def miscounted(tmp_path: Path) -> str:
    """A video whose container says that it has more frames than it has."""
    whole = Path(write_video(tmp_path / "whole.avi"))
    cut = tmp_path / "cut.avi"
    cut.write_bytes(whole.read_bytes()[: 6 * whole.stat().st_size // 10])
    return str(cut)


def test_of_a_video_the_frames_that_there_are_need_a_line(miscounted: str, tmp_path: Path) -> None:
    count = len(list(open_source(miscounted)))
    assert count < open_source(miscounted).count
    for lines in (count, COUNT):
        parts = Parts(poses=kitti(tmp_path / "00.txt", lines))
        assert [frame.pose.x for frame in open_source(miscounted, parts=parts)] == [*range(count)]
    parts = Parts(poses=kitti(tmp_path / "00.txt", COUNT + 1))
    with pytest.raises(SourceError, match=f"{COUNT + 1} lines for {count} frames"):
        list(open_source(miscounted, parts=parts))
    parts = Parts(poses=kitti(tmp_path / "00.txt", count - 1))
    with pytest.raises(
        SourceError, match=rf"{count - 1} lines, but none for cut.avi#{count - 1}; give a line"
    ):
        list(open_source(miscounted, parts=parts))


def test_in_a_gap_of_the_poses_frames_are_not_spaced_and_the_advice_is_to_fill_it(
    stamped: Path, tmp_path: Path
) -> None:
    poses = tum(tmp_path / "poses.txt")
    lines = poses.read_text().splitlines()
    poses.write_text("\n".join(lines[:5] + lines[30:]))
    source = open_source(str(stamped), parts=Parts(poses=poses), spacing_m=1)
    with pytest.raises(
        SourceError, match=r"^drive/05\.png: .* poses that are at most 2 s apart there$"
    ):
        list(source)


def test_topics_are_for_recordings(folder: Path) -> None:
    for parts in (Parts(topic="/a"), Parts(odometry_topic="/a")):
        with pytest.raises(SourceError, match="drive: has no topics"):
            open_source(str(folder), parts=parts)


def test_a_map_has_the_poses_of_the_first_reference(folder: Path, tmp_path: Path) -> None:
    parts = Parts(poses=tum(tmp_path / "poses.txt"))
    darker = tmp_path / "darker"
    darker.mkdir()
    for file in folder.iterdir():
        cv2.imwrite(str(darker / file.name), cv2.imread(str(file)) // 2)
    built = build_from([str(folder), str(darker)], CONFIG, parts=parts)
    assert built.pose_frame == "route"
    np.testing.assert_allclose(built.places.poses[:, 1], np.arange(COUNT) / 2, atol=1e-9)


def test_a_map_says_where_georeferenced_its_metres_are(folder: Path) -> None:
    rows = [f"{at:02}.png,{-27.5 + at / 1e5:.5f},153" for at in range(COUNT)]
    (folder / "frames.csv").write_text("\n".join(["file,latitude,longitude", *rows]))
    built = build_from([str(folder)], CONFIG)
    origin = Origin.of_frame(built.pose_frame)
    assert origin == Origin(-27.5, 153)
    degrees = [origin.to_degrees(*pose[:2]) for pose in built.places.poses]
    expected = [(-27.5 + at / 1e5, 153) for at in range(COUNT)]
    np.testing.assert_allclose(degrees, expected, atol=1e-8)


@pytest.mark.parametrize("empty", [",", "0,0", "0.0,-0.0"])
@pytest.mark.parametrize("missing", [range(1), range(9, 20), range(0, COUNT, 2), range(30, COUNT)])
def test_a_map_has_poses_where_they_are_known(folder: Path, missing: range, empty: str) -> None:
    rows = [
        f"{at:02}.png,{empty}" if at in missing else f"{at:02}.png,{10 + at / 1e5:.5f},20"
        for at in range(COUNT)
    ]
    (folder / "frames.csv").write_text("\n".join(["file,latitude,longitude", *rows]))
    built = build_from([str(folder)], CONFIG)
    poses = [built.places.pose(at) for at in range(COUNT)]
    assert [at for at in range(COUNT) if poses[at] is None] == [*missing]
    assert np.abs(built.places.poses[~np.isnan(built.places.poses[:, 0]), :2]).max() < 100
    assert built.places.travelled[-1] == pytest.approx(1.106 * (COUNT - 1), rel=0.01)


def test_poses_are_joined_by_number_where_frames_have_no_stamps(
    folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    at_5_hz = tmp_path / "5hz.tum"
    at_5_hz.write_text("\n".join(f"{at / 5} {at / 2} 0 0 0 0 0 1" for at in range(COUNT)))
    parts = Parts(poses=at_5_hz)
    frames = list(open_source(str(folder), parts=replace(parts, start=3, stride=4)))
    assert [frame.pose.x for frame in frames] == [at / 2 for at in range(3, COUNT, 4)]
    assert "line i is used for frame i" in caplog.text


@pytest.mark.parametrize("last", [COUNT - 2, COUNT])
def test_neither_by_stamp_nor_by_number_is_refused_in_a_line(
    folder: Path, tmp_path: Path, last: int
) -> None:
    parts = Parts(poses=tum(tmp_path / "poses.txt", 0, last))
    with pytest.raises(SourceError, match=r"another number of frames.*column stamp$") as refused:
        open_source(str(folder), parts=parts)
    assert "\n" not in str(refused.value)


def test_axes_without_a_file_are_refused(folder: Path) -> None:
    with pytest.raises(SourceError, match=r"--pose-axes z-forward: .* --poses"):
        open_source(str(folder), parts=Parts(pose_axes="z-forward"))


def test_frames_before_the_first_fix_are_left_out_of_spaced_ones_and_counted(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    way = Trajectory.of(
        np.arange(5, COUNT) * 10**8, np.arange(5.0, COUNT)[:, np.newaxis] * [1, 0, 0]
    )
    with_poses = WithPoses(Folder(folder), way, "/fix", span_ns=(0, 10**10))
    assert [frame.index for frame in DistanceSampled(with_poses, 2.0)] == list(range(5, COUNT, 2))
    assert "5 frames before the first pose" in caplog.text
