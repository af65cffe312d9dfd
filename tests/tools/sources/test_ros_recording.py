import re
import sqlite3
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree
from typing import Any

import cv2
import numpy as np
import pymap3d
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from placefield.config import Config
from placefield.errors import ConfigError, SourceError
from placefield.features.frames import Frame, Pose
from placefield.maps.geography import Origin
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.sources import Parts, mcap_summary, open_source

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
LATE_NS = 7_000_000  # from a message's stamp until it is recorded
RATE = 10
COUNT = 8

COMPRESSED, IMAGE = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image"
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"
COVARIANT = "geometry_msgs/msg/PoseWithCovarianceStamped"
FIX = "sensor_msgs/msg/NavSatFix"

FORMATS = ("ros1", "sqlite3", "mcap", "zstd")


@dataclass(frozen=True)
class Said:
    """A message, as its fields that are not 0; it is stamped so many seconds from the start."""

    topic: str
    kind: str
    second: float
    fields: dict[str, Any]
    is_stamped: bool = True


def record(path: Path, said: Sequence[Said], form: str = "mcap") -> str:
    """Write a recording with rosbags' own writers; return what to give to Placefield."""
    if form == "ros1":
        store = get_typestore(Stores.ROS1_NOETIC)
        path = path.with_suffix(".bag")
        writer: Any = Writer1(path)
        serialize = store.serialize_ros1
    else:
        store = get_typestore(Stores.ROS2_JAZZY)
        plugin = StoragePlugin.SQLITE3 if form == "sqlite3" else StoragePlugin.MCAP
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if form == "zstd":
            writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
        serialize = store.serialize_cdr
    with writer:
        channels = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in sorted({(each.topic, each.kind) for each in said})
        }
        for each in said:
            stamp_ns = START_NS + round(each.second * SECOND)
            seconds, rest = divmod(stamp_ns if each.is_stamped else 0, SECOND)
            fields = {"header": {"stamp": {"sec": seconds, "nanosec": rest}}} | each.fields
            data = serialize(message(store, each.kind, fields), each.kind)
            writer.write(channels[each.topic], stamp_ns + LATE_NS, data)
    return str(path)


def message(store: Any, kind: str, fields: dict[str, Any]) -> Any:
    """Make a message of a type: what is not among the fields is 0, or empty."""
    values = {}
    for name, (node, of) in store.fielddefs[kind][1]:
        if node.name == "NAME":
            values[name] = message(store, of, fields.get(name, {}))
        elif node.name == "BASE":
            values[name] = fields.get(name, "" if of[0] == "string" else 0)
        else:
            values[name] = fields.get(name, np.zeros(of[1]))
    return store.types[kind](**values)


def jpeg(index: int) -> np.ndarray:
    return cv2.imencode(".jpg", np.full((16, 24), 10 * index + 5, np.uint8))[1].ravel()


def images(topic: str = "/camera/compressed", **how: Any) -> list[Said]:
    return [
        Said(topic, COMPRESSED, at / RATE, {"format": "jpeg", "data": jpeg(at)}, **how)
        for at in range(COUNT)
    ]


def pose(x: float, y: float, yaw: float = 0) -> dict[str, Any]:
    turn = {"z": np.sin(yaw / 2), "w": np.cos(yaw / 2)}
    return {"position": {"x": x, "y": y}, "orientation": turn}


def frames_of(where: str, parts: Parts = Parts()) -> list[Frame]:  # noqa: B008
    with open_source(where, parts=parts) as source:
        frames = list(source)
        assert source.count == len(frames)
        assert [frame.index for frame in source] == [frame.index for frame in frames]
        assert not source.live
    return frames


@pytest.mark.parametrize("form", FORMATS)
def test_compressed_images_come_as_they_were_recorded(tmp_path: Path, form: str) -> None:
    where = record(tmp_path / "drive", images(), form)
    frames = frames_of(where)
    assert [frame.image for frame in frames] == [jpeg(at).tobytes() for at in range(COUNT)]
    assert [frame.stamp_ns for frame in frames] == [
        START_NS + at * SECOND // RATE for at in range(COUNT)
    ]
    assert frames[3].name == f"{Path(where).name}#3"
    assert {frame.pose for frame in frames} == {None}
    chosen = frames_of(where, Parts(start=1, stride=3))
    assert [frame.index for frame in chosen] == [1, 4, 7]
    assert chosen[1].image == frames[4].image


@pytest.mark.parametrize("form", FORMATS)
def test_raw_images_come_as_pixels(tmp_path: Path, form: str) -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (9, 10, 3)).astype(np.uint8)
    fields = {"height": 9, "width": 10, "encoding": "rgb8", "step": 30, "data": rgb.ravel()}
    [frame] = frames_of(record(tmp_path / "drive", [Said("/raw", IMAGE, 0, fields)], form))
    np.testing.assert_array_equal(frame.image, rgb[:, :, ::-1])


@pytest.mark.parametrize("form", ["ros1", "mcap"])
def test_a_message_without_a_stamp_has_the_recorders(tmp_path: Path, form: str) -> None:
    frames = frames_of(record(tmp_path / "drive", images(is_stamped=False), form))
    assert [frame.stamp_ns - LATE_NS for frame in frames[:2]] == [START_NS, START_NS + SECOND // 10]


def test_a_single_file_of_a_recording_will_do(tmp_path: Path) -> None:
    record(tmp_path / "drive", images())
    [file] = (tmp_path / "drive").glob("*.mcap")
    assert len(frames_of(str(file))) == COUNT


def test_of_several_topics_one_is_to_be_named(tmp_path: Path) -> None:
    where = record(tmp_path / "drive", images("/left") + images("/right")[:3])
    with pytest.raises(SourceError, match=r"choose with --topic one of /left, /right$"):
        open_source(where)
    with pytest.raises(SourceError, match="--topic /up: has no images; choose"):
        open_source(where, parts=Parts(topic="/up"))
    assert len(frames_of(where, Parts(topic="/right"))) == 3


def test_a_recording_without_images_says_what_it_holds(tmp_path: Path) -> None:
    where = record(tmp_path / "drive", [Said("/pose", POSE, 0, {"pose": pose(0, 0)})])
    with pytest.raises(SourceError, match=r"no topic of images.*/pose \(geometry_msgs"):
        open_source(where)


@pytest.mark.parametrize("form", ["ros1", "mcap"])
@pytest.mark.parametrize("kind", [ODOMETRY, POSE, COVARIANT])
def test_poses_lie_between_those_recorded_and_metres_are_counted(
    tmp_path: Path, form: str, kind: str
) -> None:
    corner = [(-0.5, pose(0, 0, 3)), (0.3, pose(4, 0, -3)), (1.1, pose(4, 2, -3))]
    said = [
        Said("/odom", kind, second, {"pose": at if kind == POSE else {"pose": at}})
        for second, at in corner
    ]
    frames = frames_of(record(tmp_path / "drive", images() + said, form))
    seconds = np.arange(COUNT) / RATE
    x = np.interp(seconds, [-0.5, 0.3], [0, 4])
    y = np.interp(seconds, [0.3, 1.1], [0, 2])
    found = np.array([(frame.pose.x, frame.pose.y, frame.odometry_m) for frame in frames])
    np.testing.assert_allclose(found, np.column_stack([x, y, x + y]), atol=1e-6)
    assert all(abs(frame.pose.yaw) >= 3 - 1e-9 for frame in frames)  # it turns past π


def test_fixes_become_metres_from_the_first_and_what_is_no_fix_is_left_out(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    none = {"status": {"status": -1}}
    fixes = [(-0.2, -27.5, 153.0), (0.4, -27.49999, 153.0), (1.0, -27.49999, 153.00002)]
    said = [Said("/fix", FIX, at, {"latitude": n, "longitude": e}) for at, n, e in fixes]
    said += [Said("/fix", FIX, -0.5, none), Said("/fix", FIX, 0.5, {"latitude": np.nan})]
    where = record(tmp_path / "drive", images() + said)
    with open_source(where) as source:
        assert source.origin == Origin(-27.5, 153.0)
        fourth = list(source)[4]
    _, north, _ = pymap3d.geodetic2enu(-27.49999, 153.0, 0, -27.5, 153.0, 0)
    assert (fourth.pose.x, fourth.pose.y) == pytest.approx((0, north), abs=1e-6)
    assert fourth.pose.yaw == pytest.approx(0, abs=1e-3)  # from here on to the east
    assert caplog.messages == ["drive:/fix: 3 of 5 messages have a position"]


@pytest.mark.parametrize(
    "nowhere",
    [
        {"latitude": 0.0, "longitude": 0.0},
        {"latitude": np.nan, "longitude": np.nan},
        {"status": {"status": -1}, "latitude": 3.0, "longitude": 4.0},
    ],
)
@pytest.mark.parametrize("span", [(-1.0, 0.25), (0.25, 9.0)])
def test_frames_without_a_fix_keep_their_turn_and_have_no_pose(
    tmp_path: Path, nowhere: dict[str, Any], span: tuple[float, float]
) -> None:
    said = [
        Said(
            "/fix",
            FIX,
            at / 10,
            nowhere
            if span[0] <= at / 10 < span[1]
            else {"latitude": 50 + at / 1e5, "longitude": 8.0},
        )
        for at in range(-5, 16)
    ]
    where = record(tmp_path / "drive", images() + said)
    with open_source(where) as source:
        frames = list(source)
    assert len(frames) == COUNT
    known = [frame.pose for frame in frames if frame.pose is not None]
    assert 0 < len(known) < COUNT
    assert max(abs(pose.x) + abs(pose.y) for pose in known) < 100
    unknown = [frame for frame in frames if frame.pose is None]
    assert all(frame.odometry_m is None for frame in unknown)


def test_frames_before_the_first_pose_and_after_the_last_are_left_out_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    said = [Said("/odom", POSE, at / 10, {"pose": pose(at, 0)}) for at in range(2, 6)]
    with open_source(record(tmp_path / "drive", images() + said)) as source:
        frames = list(source)
    assert [(frame.index, frame.pose) for frame in frames] == [
        (at, Pose(at, 0, 0)) for at in range(2, 6)
    ]
    assert "drive:/odom: 4 of 8 frames" in caplog.text


def test_a_gap_of_more_than_two_seconds_has_no_poses(tmp_path: Path) -> None:
    seconds = [0, 1, 2.5, 4.0, 5]
    frames = [
        Said("/image", COMPRESSED, second, {"data": jpeg(at)}) for at, second in enumerate(seconds)
    ]
    said = [Said("/odom", POSE, at, {"pose": pose(at, 0)}) for at in (0, 1.5, 4, 5)]
    found = frames_of(record(tmp_path / "drive", frames + said))
    assert [frame.pose and frame.pose.x for frame in found] == pytest.approx([0, 1, None, 4, 5])


def test_of_several_topics_of_poses_the_one_that_is_asked_for_counts(tmp_path: Path) -> None:
    said = [
        Said(topic, POSE, at / 10, {"pose": pose(metres, 0)})
        for at in range(COUNT)
        for topic, metres in (("/a", 1), ("/b", 2))
    ]
    where = record(tmp_path / "drive", images() + said)
    assert {frame.pose for frame in frames_of(where)} == {None}
    [of_b] = {frame.pose for frame in frames_of(where, Parts(odometry_topic="/b"))}
    assert of_b == Pose(2, 0, 0)
    with pytest.raises(SourceError, match=r"--odometry-topic /c: .*it holds poses in /a, /b$"):
        open_source(where, parts=Parts(odometry_topic="/c"))


def test_poses_may_be_left_out(tmp_path: Path) -> None:
    said = [*images(), Said("/odom", POSE, 0, {"pose": pose(np.nan, 0)})]
    where = record(tmp_path / "drive", said)
    with pytest.raises(SourceError, match="/odom: none of 1 messages has a position; "):
        open_source(where)
    assert {frame.pose for frame in frames_of(where, Parts(odometry_topic="none"))} == {None}


def test_stamps_of_another_clock_are_reported(tmp_path: Path) -> None:
    said = [Said("/odom", POSE, 1000 + at, {"pose": pose(at, 0)}) for at in range(3)]
    with (
        open_source(record(tmp_path / "drive", images() + said)) as source,
        pytest.raises(SourceError, match=r"none of the 8 frames .* one clock"),
    ):
        list(source)


def test_a_recording_says_what_is_to_be_installed_to_read_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = record(tmp_path / "drive", images())
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    monkeypatch.delitem(sys.modules, "placefield_tools.sources.ros_recording", raising=False)
    with pytest.raises(ConfigError, match=r"drive needs rosbags.*pip install 'placefield\[ros\]'"):
        open_source(where)


def test_a_start_beyond_the_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"--start 8: .*/camera/compressed holds only 8 frames"):
        open_source(record(tmp_path / "drive", images()), parts=Parts(start=COUNT))


def test_a_bag_with_a_chunk_of_more_memory_than_is_allowed_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = record(tmp_path / "drive", images())
    monkeypatch.setattr(mcap_summary, "MAX_CHUNK_BYTES", 2**10)
    with pytest.raises(SourceError, match=r"\.mcap: has a chunk of"):
        open_source(where)


def test_an_image_that_does_not_fit_its_fields_is_named(tmp_path: Path) -> None:
    fields = {"height": 9, "width": 9, "encoding": "rgb8", "data": np.zeros(9, np.uint8)}
    with open_source(record(tmp_path / "drive", [Said("/raw", IMAGE, 7, fields)])) as source:
        [frame] = source
    assert (frame.name, frame.image) == ("drive#0", b"")
    assert frame.fault.startswith("the image of 9×9")


def test_what_lies_in_a_databases_log_is_asked_for_and_read_when_it_was_brought_in(
    tmp_path: Path,
) -> None:
    bag = Path(record(tmp_path / "drive", images(), "sqlite3"))
    [database] = bag.glob("*.db3")
    recorder = sqlite3.connect(database)
    recorder.execute("PRAGMA journal_mode=WAL")
    with recorder:
        recorder.execute("DELETE FROM messages WHERE id > 4")
    where = copytree(bag, tmp_path / "killed")
    recorder.close()
    with pytest.raises(SourceError, match=rf"{database.name}-wal: holds messages") as refused:
        open_source(str(where))
    remedy = re.search(r"sqlite3 (\S+) '(.*)'", str(refused.value))
    assert remedy is not None
    mended = sqlite3.connect(where / remedy[1])
    mended.execute(remedy[2])
    mended.close()
    assert len(list(open_source(str(where)))) == 4


def test_images_that_a_bag_promises_and_has_not_are_counted_and_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = Path(record(tmp_path / "drive", images(), "sqlite3"))
    with open_source(str(bag)) as whole:
        assert len(list(whole)) == COUNT
        assert not whole.not_given["missing"]
    assert not caplog.records
    [database] = bag.glob("*.db3")
    with sqlite3.connect(database) as lost:
        lost.execute("DELETE FROM messages WHERE id > 4")
    source = open_source(str(bag))
    assert len(list(source)) == 4
    assert source.not_given["missing"] == COUNT - 4
    assert f"should hold {COUNT} images" in caplog.text
    assert f"{COUNT - 4} of them are missing" in caplog.text
    with pytest.raises(SourceError, match=f"{COUNT - 4} frames are missing"):
        build_from([str(bag)], Config())


@pytest.mark.parametrize(("form", "suffix"), [("sqlite3", "db3"), ("mcap", "mcap")])
def test_a_file_that_a_bags_metadata_do_not_list_is_reported(
    tmp_path: Path, form: str, suffix: str
) -> None:
    bag = Path(record(tmp_path / "drive", images(), form))
    assert len(list(open_source(str(bag)))) == COUNT
    (bag / f"drive_1.{suffix}").write_bytes((bag / f"drive.{suffix}").read_bytes())
    with pytest.raises(SourceError, match=rf"metadata.yaml: does not list drive_1.{suffix}, "):
        open_source(str(bag))


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
@pytest.mark.parametrize("share", [0, 0.1, 0.5, 0.95])
def test_a_recording_that_was_cut_off_is_reported_in_one_line(
    tmp_path: Path, form: str, share: float
) -> None:
    where = Path(record(tmp_path / "drive", images(), form))
    file = where if where.is_file() else next(p for p in where.iterdir() if p.suffix != ".yaml")
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    with pytest.raises(SourceError, match="^" + re.escape(str(where))) as refused:
        list(open_source(str(where)))
    assert "\n" not in str(refused.value)
