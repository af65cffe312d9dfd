import base64
import json
import math
import os
import struct
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, timestamp_pb2
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore
from test_ros_recording import images as ros_images
from test_ros_recording import record as record_ros

from placefield.errors import ConfigError, FrameError, SourceError
from placefield.maps.geography import Origin
from placefield_tools.sources import Parts, mcap_summary, open_source

ROS_KIND = "sensor_msgs/msg/CompressedImage"
ROS_STORE = get_typestore(Stores.ROS2_JAZZY)
CASES = Path(os.environ.get("PLACEFIELD_CASES") or Path(__file__).parents[4] / "shared" / "cases")

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
IMAGES = [f"JPEG {index}".encode() for index in range(4)]
KIND = "foxglove.CompressedImage"

Encoded = Callable[[int, bytes], bytes]


def stamps(index: int) -> int:
    return START_NS + index * SECOND // 5


def as_json(stamp_ns: int, image: bytes) -> bytes:
    sec, nsec = divmod(stamp_ns, SECOND)
    text = base64.b64encode(image).decode()
    fields = {"timestamp": {"sec": sec, "nsec": nsec}, "frame_id": "", "data": text}
    return json.dumps(fields | {"format": "jpeg"}).encode()


def as_protobuf(stamp_ns: int, image: bytes) -> bytes:
    """Foxglove's numbers are 1 for the timestamp and 2 for the data."""
    stamp = timestamp_pb2.Timestamp()
    stamp.FromNanoseconds(stamp_ns)
    parts = {1: stamp.SerializeToString(), 2: image, 3: b"jpeg"}
    return b"".join(bytes([8 * number + 2, len(part)]) + part for number, part in parts.items())


def protobuf_schema() -> bytes:
    """A set of files of which the first imports the second."""
    image = descriptor_pb2.FileDescriptorProto(name="foxglove/image.proto", package="foxglove")
    image.syntax = "proto3"
    image.dependency.append("google/protobuf/timestamp.proto")
    message = image.message_type.add(name="CompressedImage")
    field = descriptor_pb2.FieldDescriptorProto
    message.field.add(
        name="timestamp", number=1, type=field.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp"
    ).label = field.LABEL_OPTIONAL
    for name, number, kind in (
        ("data", 2, field.TYPE_BYTES),
        ("format", 3, field.TYPE_STRING),
        ("frame_id", 4, field.TYPE_STRING),
    ):
        message.field.add(name=name, number=number, type=kind).label = field.LABEL_OPTIONAL
    imported = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(imported)
    return descriptor_pb2.FileDescriptorSet(file=[image, imported]).SerializeToString()


FORMS: dict[str, tuple[str, bytes, Encoded]] = {
    "json": ("jsonschema", b"{}", as_json),
    "protobuf": ("protobuf", protobuf_schema(), as_protobuf),
}


def record(path: Path, form: str, *topics: str, stamped: bool = True) -> str:
    encoding, definition, encode = FORMS[form]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(KIND, encoding, definition)
        for topic in topics:
            channel = writer.register_channel(topic, form, schema)
            for index, image in enumerate(IMAGES):
                data = encode(stamps(index) if stamped else 0, image)
                writer.add_message(channel, stamps(index) + 5, data, publish_time=0)
        writer.finish()
    return str(path)


@pytest.mark.parametrize("form", FORMS)
def test_images_come_as_they_were_recorded(tmp_path: Path, form: str) -> None:
    with open_source(record(tmp_path / "a.mcap", form, "/image")) as source:
        frames = list(source)
        assert source.count == len(IMAGES)
        assert not source.live
        assert [frame.image for frame in source] == [frame.image for frame in frames]
    assert [frame.image for frame in frames] == IMAGES
    assert [frame.stamp_ns for frame in frames] == [stamps(index) for index in range(len(IMAGES))]
    assert [frame.name for frame in frames[:2]] == ["a.mcap#0", "a.mcap#1"]
    chosen = list(open_source(str(tmp_path / "a.mcap"), parts=Parts(start=1, stride=2)))
    assert [(frame.index, frame.image) for frame in chosen] == [(1, IMAGES[1]), (3, IMAGES[3])]


@pytest.mark.parametrize("form", FORMS)
def test_an_image_without_a_stamp_has_the_recorders(tmp_path: Path, form: str) -> None:
    frames = list(open_source(record(tmp_path / "a.mcap", form, "/image", stamped=False)))
    assert [frame.stamp_ns for frame in frames[:2]] == [stamps(0) + 5, stamps(1) + 5]


def test_of_several_topics_one_is_to_be_named(tmp_path: Path) -> None:
    where = record(tmp_path / "a.mcap", "json", "/left", "/right")
    with pytest.raises(SourceError, match="--topic one of /left, /right"):
        open_source(where)
    assert len(list(open_source(where, parts=Parts("/right")))) == len(IMAGES)
    with pytest.raises(SourceError, match=r"--odometry-topic /odom: .* poses in no topic"):
        open_source(where, parts=Parts("/right", "/odom"))


def fix_schema() -> bytes:
    """Of flat messages, with numbers of fields that are ours."""
    file = descriptor_pb2.FileDescriptorProto(name="fix.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    message = file.message_type.add(name="LocationFix")
    field = descriptor_pb2.FieldDescriptorProto
    message.field.add(
        name="timestamp", number=1, type=field.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp"
    ).label = field.LABEL_OPTIONAL
    for number, name in ((2, "latitude"), (3, "longitude")):
        degrees = message.field.add(name=name, number=number, type=field.TYPE_DOUBLE)
        degrees.label = field.LABEL_OPTIONAL
    imported = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(imported)
    return descriptor_pb2.FileDescriptorSet(file=[file, imported]).SerializeToString()


def stamped(stamp_ns: int, **fields: object) -> bytes:
    sec, nsec = divmod(stamp_ns, SECOND)
    return json.dumps({"timestamp": {"sec": sec, "nsec": nsec}, **fields}).encode()


def pose_as_json(stamp_ns: int, east: float, north: float) -> bytes:
    turned = {"x": 0, "y": 0, "z": 0.5**0.5, "w": 0.5**0.5}
    pose = {"position": {"x": east, "y": north, "z": 0}, "orientation": turned}
    return stamped(stamp_ns, frame_id="map", pose=pose)


def fix_as_json(stamp_ns: int, east: float, north: float) -> bytes:
    latitude, longitude = Origin(48.1, 11.5).to_degrees(east, north)
    return stamped(stamp_ns, latitude=latitude, longitude=longitude, altitude=0)


def fix_as_protobuf(stamp_ns: int, east: float, north: float) -> bytes:
    stamp = timestamp_pb2.Timestamp()
    stamp.FromNanoseconds(stamp_ns)
    written = stamp.SerializeToString()
    degrees = Origin(48.1, 11.5).to_degrees(east, north)
    doubles = [
        bytes([8 * number + 1]) + struct.pack("<d", each) for number, each in enumerate(degrees, 2)
    ]
    return b"".join([bytes([10, len(written)]), written, *doubles])


@pytest.mark.parametrize(
    ("kind", "form", "schema", "encode"),
    [
        ("foxglove.PoseInFrame", "json", b"{}", pose_as_json),
        ("foxglove.LocationFix", "json", b"{}", fix_as_json),
        ("foxglove.LocationFix", "protobuf", fix_schema(), fix_as_protobuf),
    ],
)
def test_frames_have_the_poses_of_their_time(
    tmp_path: Path,
    kind: str,
    form: str,
    schema: bytes,
    encode: Callable[[int, float, float], bytes],
) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        image = writer.register_channel(
            "/image", "json", writer.register_schema(KIND, "jsonschema", b"{}")
        )
        definition = "jsonschema" if form == "json" else "protobuf"
        where = writer.register_channel(
            "/where", form, writer.register_schema(kind, definition, schema)
        )
        for index, data in enumerate(IMAGES):
            writer.add_message(image, stamps(index), as_json(stamps(index), data), publish_time=0)
        for index in range(-1, 2 * len(IMAGES)):  # half a frame apart, 3 m to the north
            at = stamps(0) + index * SECOND // 10
            writer.add_message(where, at, encode(at, 5, 3 * index), publish_time=0)
        writer.finish()
    frames = list(open_source(str(path)))
    first = frames[0].pose
    for index, frame in enumerate(frames):
        assert frame.pose.y - first.y == pytest.approx(6 * index, abs=1e-3)
        assert frame.pose.x == pytest.approx(first.x, abs=1e-3)
        assert frame.pose.yaw == pytest.approx(math.pi / 2, abs=1e-4)
        assert frame.odometry_m == pytest.approx(6 * index + 3, abs=1e-3)
    assert [frame.pose for frame in open_source(str(path), parts=Parts(None, "none"))] == [None] * 4


def compressed(store: Any, image: bytes) -> Any:
    kinds = store.types
    stamp = kinds["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    more = {"seq": 0} if store is not ROS_STORE else {}
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="", **more)
    return kinds[ROS_KIND](header=header, format="jpeg", data=np.frombuffer(image, np.uint8))


def as_cdr(image: bytes) -> bytes:
    return bytes(ROS_STORE.serialize_cdr(compressed(ROS_STORE, image), ROS_KIND))


def record_both(path: Path) -> str:
    """A recording of an image of Foxglove's on /fox and one of ROS's on /ros."""
    encoding, definition, encode = FORMS["json"]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        fox = writer.register_schema(KIND, encoding, definition)
        of_ros = writer.register_schema(
            ROS_KIND, "ros2msg", ROS_STORE.generate_msgdef(ROS_KIND)[0].encode()
        )
        channels = [
            writer.register_channel("/fox", "json", fox),
            writer.register_channel("/ros", "cdr", of_ros),
        ]
        for channel, data in zip(channels, (encode(1, IMAGES[0]), as_cdr(IMAGES[1])), strict=True):
            writer.add_message(channel, 1, data, publish_time=1)
        writer.finish()
    return str(path)


def test_of_images_of_foxglove_and_of_ros_the_topic_decides(tmp_path: Path) -> None:
    where = record_both(tmp_path / "a.mcap")
    for asked in (None, "/image"):
        with pytest.raises(SourceError, match=r"choose with --topic one of /fox, /ros$"):
            open_source(where, parts=Parts(asked))
    assert [frame.image for frame in open_source(where, parts=Parts("/fox"))] == IMAGES[:1]
    assert [frame.image for frame in open_source(where, parts=Parts("/ros"))] == IMAGES[1:2]


@pytest.mark.parametrize(
    ("kind", "encoding", "definition", "form"),
    [
        (
            "example_interfaces/srv/AddTwoInts_Event",
            "ros2msg",
            "int64 a\n---\nint64 sum\n" * 99,
            "cdr",
        ),
        ("mine/msg/Broken", "ros2idl", "module { nonsense", "cdr"),
        ("State", "jsonschema", "{", "json"),
        ("mine.State", "protobuf", "no protobuf", "protobuf"),
        ("State", "flatbuffer", "?", "flatbuffer"),
    ],
)
def test_topics_that_nobody_asks_for_are_not_parsed(
    tmp_path: Path, kind: str, encoding: str, definition: str, form: str
) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schemas = [
            writer.register_schema(kind, encoding, definition.encode()),
            writer.register_schema(
                ROS_KIND, "ros2msg", ROS_STORE.generate_msgdef(ROS_KIND)[0].encode()
            ),
        ]
        other = writer.register_channel("/other", form, schemas[0])
        channel = writer.register_channel("/image", "cdr", schemas[1])
        for at, image in enumerate(IMAGES):
            writer.add_message(other, at, b"what nobody reads", publish_time=at)
            writer.add_message(channel, at + 1, as_cdr(image), publish_time=at)
        writer.finish()
    assert [frame.image for frame in open_source(str(path))] == IMAGES
    with pytest.raises(SourceError, match="--topic /other: has no images") as refused:
        open_source(str(path), parts=Parts("/other"))
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("form", ["ros1", "ros2"])
def test_images_of_ros_1_and_2_in_one_file_format(tmp_path: Path, form: str) -> None:
    store = get_typestore(Stores.ROS1_NOETIC) if form == "ros1" else ROS_STORE
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        name = "sensor_msgs/CompressedImage" if form == "ros1" else ROS_KIND
        definition = store.generate_msgdef(ROS_KIND, ros_version=int(form[-1]))[0].encode()
        schema = writer.register_schema(name, f"{form}msg", definition)
        channel = writer.register_channel("/image", "cdr" if form == "ros2" else "ros1", schema)
        for at, image in enumerate(IMAGES):
            message = compressed(store, image)
            data = (
                store.serialize_ros1(message, ROS_KIND)
                if form == "ros1"
                else store.serialize_cdr(message, ROS_KIND)
            )
            writer.add_message(channel, at, bytes(data), publish_time=at)
        writer.finish()
    assert [frame.image for frame in open_source(str(path))] == IMAGES


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "bgr8"])
def test_raw_images_of_foxglove_are_the_pixels_that_opencv_makes_of_them(
    tmp_path: Path, encoding: str
) -> None:
    shape = (8, 10) if encoding == "mono8" else (8, 10, 3)
    pixels = np.random.default_rng(1).integers(0, 255, shape, np.uint8)
    where = record_json(
        tmp_path / "a.mcap",
        "foxglove.RawImage",
        [
            {
                "width": 10,
                "height": 8,
                "encoding": encoding,
                "step": pixels.strides[0],
                "data": base64.b64encode(pixels.tobytes()).decode(),
            }
        ],
    )
    expected = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if encoding == "rgb8" else pixels
    [frame] = open_source(where)
    np.testing.assert_array_equal(frame.image, expected)


def h264(pictures: list[np.ndarray]) -> list[bytes]:
    av = pytest.importorskip("av")
    codec = av.CodecContext.create("libx264", "w")
    codec.width, codec.height, codec.pix_fmt, codec.framerate = 64, 48, "yuv420p", 10
    codec.options = {"tune": "zerolatency", "g": "5", "x264-params": "repeat-headers=1"}
    packets = [
        packet
        for picture in pictures
        for packet in codec.encode(av.VideoFrame.from_ndarray(picture, format="bgr24"))
    ]
    return [bytes(packet) for packet in [*packets, *codec.encode(None)]]


def video(path: Path, packets: list[bytes]) -> str:
    fields = [{"format": "h264", "data": base64.b64encode(each).decode()} for each in packets]
    return record_json(path, "foxglove.CompressedVideo", fields)


def test_compressed_video_is_decoded_frame_by_frame(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    greys = [20 * at + 10 for at in range(12)]
    packets = h264([np.full((48, 64, 3), grey, np.uint8) for grey in greys])
    assert len(packets) == 12
    frames = list(open_source(video(tmp_path / "a.mcap", packets)))
    assert [np.median(frame.image) for frame in frames] == pytest.approx(greys, abs=4)
    assert [
        frame.index
        for frame in open_source(str(tmp_path / "a.mcap"), parts=Parts(start=3, stride=4))
    ] == [
        3,
        7,
        11,
    ]
    assert not caplog.messages
    later = list(open_source(video(tmp_path / "b.mcap", packets[2:])))
    assert [np.median(frame.image) for frame in later] == pytest.approx(greys[5:], abs=4)
    assert "begins with 3 messages without an image" in caplog.text


def test_video_that_nothing_here_decodes_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ConfigError, match=r"a\.mcap: .*needs av: pip install 'placefield\[ros\]'"):
        open_source(video(tmp_path / "a.mcap", [b"?"]))


@pytest.mark.parametrize("data", [b"", b"\0\0\0\1 no video"])
def test_video_that_does_not_decode_is_one_line(tmp_path: Path, data: bytes) -> None:
    pytest.importorskip("av")
    with pytest.raises(SourceError, match=r"^[^\n]{1,300}$"):
        list(open_source(video(tmp_path / "a.mcap", [data])))


def record_json(path: Path, kind: str, messages: Sequence[dict[str, object]]) -> str:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/image", "json", writer.register_schema(kind, "jsonschema", b"{}")
        )
        for at, fields in enumerate(messages):
            writer.add_message(channel, at, stamped(stamps(at), **fields), publish_time=at)
        writer.finish()
    return str(path)


@pytest.mark.parametrize("case", ["mcap_service_event", "foxglove_raw_and_video"])
def test_a_recording_of_which_one_topic_is_wanted_is_read(case: str) -> None:
    if not (CASES / case).is_dir():
        pytest.skip(f"no cases at {CASES}; say where they are with PLACEFIELD_CASES")
    [where] = (CASES / case).glob("*.mcap")
    assert len(list(open_source(str(where)))) == 24


@pytest.mark.parametrize("compression", list(CompressionType))
def test_behind_a_damaged_chunk_a_recording_goes_on_and_what_was_lost_keeps_its_turn(
    tmp_path: Path, compression: CompressionType
) -> None:
    path, count = tmp_path / "a.mcap", 60
    encoding, definition, _ = FORMS["json"]
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4000, compression=compression)
        writer.start()
        schema = writer.register_schema(KIND, encoding, definition)
        channel = writer.register_channel("/image", "json", schema)
        for number in range(count):
            data = base64.b64encode(bytes([number]) * 500).decode()
            stamp = {"sec": number, "nsec": 0}
            message = {"timestamp": stamp, "frame_id": "", "format": "jpeg", "data": data}
            writer.add_message(channel, number, json.dumps(message).encode(), publish_time=number)
        writer.finish()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    assert len(chunks) > 4
    damaged = chunks[len(chunks) // 2]
    whole = list(open_source(str(path)))
    content = bytearray(path.read_bytes())
    end = damaged.chunk_start_offset + damaged.chunk_length
    content[end - 20 : end - 4] = bytes(range(16))
    path.write_bytes(content)
    source = open_source(str(path))
    frames = list(source)
    assert len(frames) == len(whole) == count
    assert not source.not_given["missing"]
    lost = [frame.index for frame in frames if frame.fault]
    assert lost == list(range(damaged.message_start_time, damaged.message_end_time + 1))
    for frame in (frame for frame in frames if not frame.fault):
        assert (frame.image, frame.stamp_ns) == (
            whole[frame.index].image,
            whole[frame.index].stamp_ns,
        )


def test_a_bags_folder_in_which_other_messages_are_recorded_too_is_read(tmp_path: Path) -> None:
    bag = Path(record_ros(tmp_path / "drive", ros_images(), "mcap"))
    [file] = bag.glob("*.mcap")
    with file.open("rb") as opened:
        whole = list(make_reader(opened).iter_messages())
    with file.open("wb") as opened:
        writer = Writer(opened)
        writer.start()
        other = writer.register_schema("note", "jsonschema", b"{}")
        notes = writer.register_channel("/notes", "json", other)
        schema, channel, _ = whole[0]
        assert schema is not None
        own = writer.register_schema(schema.name, schema.encoding, schema.data)
        images = writer.register_channel(channel.topic, channel.message_encoding, own)
        for _, _, message in whole:
            writer.add_message(notes, message.log_time, b'{"text": "hello"}', publish_time=1)
            writer.add_message(images, message.log_time, message.data, publish_time=1)
        writer.finish()
    with open_source(str(bag)) as source:
        assert source.count == len(whole) == len(list(source))
    metadata = bag / "metadata.yaml"
    reported = metadata.read_text()
    metadata.write_text(reported.replace("\n  - drive.mcap", "\n  - drive.mcap\n  - drive_1.mcap"))
    with pytest.raises(SourceError, match=r"lists drive_1\.mcap, which is missing"):
        open_source(str(bag))
    metadata.write_text(reported)
    file.rename(tmp_path / "elsewhere.mcap")
    with pytest.raises(SourceError, match="drive"):
        open_source(str(bag))


def test_a_chunk_that_unpacks_to_more_than_is_allowed_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_summary, "MAX_CHUNK_BYTES", 2**20)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2**30)
        writer.start()
        schema = writer.register_schema(KIND, "jsonschema", b"{}")
        for topic in ("/image", "/other"):
            channel = writer.register_channel(topic, "json", schema)
            writer.add_message(channel, 1, bytes(2**20), publish_time=1)
        writer.finish()
    assert path.stat().st_size < 1e4
    with pytest.raises(
        SourceError, match=r"a\.mcap: has a chunk of 2 MiB, and at most 1 MiB are allowed"
    ):
        open_source(str(path), parts=Parts("/image"))


def test_a_file_that_does_not_say_what_it_holds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_statistics=False)
        writer.start()
        writer.finish()
    with pytest.raises(SourceError, match=r"a\.mcap: has no summary of its content"):
        open_source(str(path))


@pytest.mark.parametrize("form", FORMS)
def test_a_message_that_cannot_be_parsed_keeps_its_turn(tmp_path: Path, form: str) -> None:
    path = Path(record(tmp_path / "a.mcap", form, "/image"))
    with path.open("rb") as file:
        whole = list(make_reader(file).iter_messages())
    encoding, definition, _ = FORMS[form]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(KIND, encoding, definition)
        channel = writer.register_channel("/image", form, schema)
        for number, (_, _, message) in enumerate(whole):
            data = b"\xff{no message" if number == 1 else message.data
            writer.add_message(channel, message.log_time, data, publish_time=1)
        writer.finish()
    frames = list(open_source(str(path)))
    assert [bool(frame.fault) for frame in frames] == [at == 1 for at in range(len(IMAGES))]
    assert [frame.image for frame in frames if not frame.fault] == [IMAGES[0], *IMAGES[2:]]
    assert frames[1].stamp_ns == frames[0].stamp_ns
    with pytest.raises(FrameError, match="the message cannot be parsed"):
        frames[1].pixels()


@pytest.mark.parametrize("form", FORMS)
def test_a_damaged_file_is_reported_in_one_line(tmp_path: Path, form: str) -> None:
    path = Path(record(tmp_path / "a.mcap", form, "/image"))
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(SourceError, match=r"a\.mcap: cannot be read as a recording") as refused:
        list(open_source(str(path)))
    assert "\n" not in str(refused.value)
