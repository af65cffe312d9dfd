from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.errors import FrameError, MapError
from placefield.features.extract import feature_of
from placefield.features.frames import Frame, Pose
from placefield.features.images import decode
from placefield.maps.traverse import DescribedFrame, describe_frame, traverse_of

GIST = feature_of("gist")


def pixels(height: int = 90, width: int = 320) -> NDArray[np.uint8]:
    noise = np.random.default_rng(2).integers(0, 256, (height, width, 3), np.uint8)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), 4), np.uint8)


def frame(
    index: int = 0, image: bytes | NDArray[np.uint8] | None = None, pose: Pose | None = None
) -> Frame:
    return Frame(index, 100 + index, f"{index:03}.jpg", pixels() if image is None else image, pose)


def jpeg() -> bytes:
    return cv2.imencode(".jpg", pixels())[1].tobytes()


def test_a_traverse_keeps_what_its_frames_have_in_their_order() -> None:
    poses = [Pose(1, 2, 3), Pose(4, 5, 6)]
    frames = [frame(0, pose=poses[0]), frame(1, pixels()[:, ::-1].copy(), poses[1])]
    traverse = traverse_of("drive", (describe_frame(each, GIST) for each in frames))
    assert traverse.name == "drive"
    expected = [GIST.describe(each.image) for each in frames]
    np.testing.assert_array_equal(traverse.raw, expected)
    assert traverse.stamps.tolist() == [100, 101]
    assert traverse.poses.tolist() == [[1, 2, 3], [4, 5, 6]]


def described(stamps: list[float], poses: list[Pose | None]) -> list[DescribedFrame]:
    """Frames at so many seconds."""
    raw = np.zeros(3, np.float32)
    return [
        DescribedFrame(raw, round(1e9 * second), pose, None, b"")
        for second, pose in zip(stamps, poses, strict=True)
    ]


def test_where_no_frame_has_a_pose_the_traverse_has_none() -> None:
    assert traverse_of("drive", described([0, 1], [None, None])).poses.shape == (0, 3)


def test_a_frame_without_a_pose_lies_between_its_neighbours_and_this_is_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    poses = [Pose(0, 0, 3), None, None, Pose(4, 8, -3)]
    traverse = traverse_of("drive", described([0, 0.5, 1.5, 2], poses), "wgs84 1.0 2.0")
    np.testing.assert_allclose(traverse.poses[1:3, :2], [[1, 2], [3, 6]])
    assert np.abs(traverse.poses[1:3, 2]).min() > 3
    assert caplog.messages == ["drive: 2 of 4 poses are interpolated"]
    assert traverse.pose_frame == "wgs84 1.0 2.0"


@pytest.mark.parametrize(
    "poses",
    [
        [Pose(0, 0, 0), None, Pose(1, 0, 0)],
        [None, Pose(0, 0, 0), Pose(1, 0, 0)],
        [Pose(0, 0, 0), Pose(1, 0, 0), None],
    ],
)
def test_a_frame_that_could_be_anywhere_has_no_pose_and_this_is_logged(
    poses: list[Pose | None], caplog: pytest.LogCaptureFixture
) -> None:
    traverse = traverse_of("drive", described([0, 1.1, 2.2], poses))
    assert np.isnan(traverse.poses[:, 0]).tolist() == [pose is None for pose in poses]
    assert caplog.messages == ["drive: 1 of 3 frames have no pose"]
    assert np.isfinite(traverse.travelled).all()
    assert (np.diff(traverse.travelled) >= 0).all()


def test_a_frame_just_outside_of_the_poses_is_at_the_first_or_the_last() -> None:
    poses = [None, Pose(1, 2, 0), Pose(3, 4, 0), None]
    traverse = traverse_of("drive", described([0.75, 1, 1.5, 1.75], poses))
    assert traverse.poses[[0, 3], :2].tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ("stamps", "stamped"), [([1, 1, 1], True), ([0, 1, 0.5], True), ([0, 0.1, 0.2], False)]
)
def test_stamps_that_do_not_ascend_or_are_invented_report_no_pose(
    stamps: list[float], stamped: bool
) -> None:
    some = described(stamps, [Pose(0, 0, 0), None, Pose(9, 0, 0)])
    found = traverse_of("drive", some, stamped=stamped).poses
    assert np.isnan(found[:, 0]).tolist() == [False, True, False]
    everywhere = [Pose(at, 0, 0) for at in range(3)]
    assert traverse_of("drive", described(stamps, list(everywhere))).poses[:, 0].tolist() == [
        0,
        1,
        2,
    ]


@pytest.mark.parametrize("stamped", [True, False])
def test_a_step_of_hundreds_of_kilometres_is_logged(
    stamped: bool, caplog: pytest.LogCaptureFixture
) -> None:
    poses: list[Pose | None] = [Pose(317_000, 0, 0), *(Pose(at, 0, 0) for at in range(5))]
    traverse_of("drive", described([*range(6)], poses), stamped=stamped)
    assert "1 of 5 steps" in caplog.text
    assert "from frame 0 to 1, 317 km" in caplog.text


def with_odometry(
    readings: list[float | None], poses: list[Pose | None] | None = None
) -> list[DescribedFrame]:
    stamps = [float(number) for number in range(len(readings))]
    frames = described(stamps, poses or [None] * len(readings))
    return [
        replace(frame, odometry_m=reading) for frame, reading in zip(frames, readings, strict=True)
    ]


def test_metres_travelled_are_the_odometrys_from_the_first_frame_on() -> None:
    poses: list[Pose | None] = [Pose(0, 0, 0), Pose(9, 0, 0), Pose(9, 0, 0)]
    traverse = traverse_of("drive", with_odometry([7.0, 7.0, 8.5], poses))
    assert traverse.travelled.tolist() == [0, 0, 1.5]


def test_where_a_reading_is_missing_metres_are_those_along_the_poses_else_unknown() -> None:
    poses: list[Pose | None] = [Pose(0, 0, 0), Pose(3, 4, 0), Pose(3, 2, 0)]
    traverse = traverse_of("drive", with_odometry([7.0, None, 8.5], poses))
    assert traverse.travelled.tolist() == [0, 5, 7]
    unknown = traverse_of("drive", with_odometry([7.0, None, 8.5])).travelled
    assert unknown.shape == (0,)
    assert unknown.dtype == np.float64


@pytest.mark.parametrize("wrong", [0.5, np.nan, np.inf, -np.inf])
def test_odometry_that_goes_back_or_is_not_finite_is_refused(wrong: float) -> None:
    with pytest.raises(MapError, match=r"^drive: the odometry of frame 2 .*correct it"):
        traverse_of("drive", with_odometry([0.0, 1.0, wrong]))


def test_no_frames_are_no_traverse() -> None:
    with pytest.raises(MapError, match="drive: no frames"):
        traverse_of("drive", [])


def test_a_thumbnail_is_the_frame_small() -> None:
    thumbnail = decode(describe_frame(frame(), GIST).thumbnail)
    assert thumbnail.shape == (45, 160, 3)
    halved = pixels().reshape(45, 2, 160, 2, 3).mean(axis=(1, 3))
    assert np.abs(thumbnail - halved).mean() < 4
    narrow = describe_frame(frame(image=pixels(100, 40)), GIST).thumbnail
    assert decode(narrow).shape == (100, 40, 3)


@pytest.mark.parametrize("share", [0, 0.3, 0.95])
def test_a_truncated_image_is_refused_by_its_name(share: float) -> None:
    broken = frame(7, jpeg()[: int(share * len(jpeg()))])
    with pytest.raises(FrameError, match=r"^007\.jpg: ") as refused:
        describe_frame(broken, GIST)
    assert "\n" not in str(refused.value)
