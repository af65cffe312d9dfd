"""An MCAP recording of Foxglove's images as a source of frames."""

import base64
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema

from placefield.errors import FrameError, SourceError
from placefield.ros.messages import IMAGES as ROS_IMAGES
from placefield_tools.sources.mcap_summary import read_summary
from placefield_tools.sources.protobuf_messages import parse_message
from placefield_tools.sources.recording import Recording, Stamped, known_errors
from placefield_tools.sources.topics import image_topic, pose_topic

_IMAGE = "foxglove.CompressedImage"


class _Topic(NamedTuple):
    kind: str
    messages: int


class _FoxgloveRecording(Recording):
    def _images(self) -> Iterator[Callable[[], Stamped]]:
        with self._path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages([self._topic]):
                yield partial(_image, schema, channel, message)


def holds_foxglove_images(path: Path, topic: str | None) -> bool:
    """Return whether an MCAP file's images are Foxglove's, and not of ROS.

    Args:
        path: of the file.
        topic: of images; None: any.

    Raises:
        SourceError: it cannot be read.
    """
    with known_errors(path):
        topics = _topics(path)
    is_of_ros = topic in topics and topics[topic].kind in ROS_IMAGES
    return not is_of_ros and any(each.kind == _IMAGE for each in topics.values())


def open_foxglove_recording(
    path: Path, topic: str | None, odometry_topic: str | None, *, start: int, stride: int
) -> Recording:
    """Open an MCAP file with ``foxglove.CompressedImage``, as JSON or protobuf; without poses.

    Args:
        path: of the file.
        topic: of images; None: the only one.
        odometry_topic: ``none`` or None; of Foxglove's poses none is read.
        start: the first frame.
        stride: from one frame to the next.

    Raises:
        SourceError: it cannot be read, holds no such topics, or ends before ``start``.
    """
    with known_errors(path):
        topics = _topics(path)
    types = {name: held.kind for name, held in topics.items()}
    images = image_topic(str(path), types, (_IMAGE, *ROS_IMAGES), topic)
    pose_topic(str(path), types, (), odometry_topic)
    return _FoxgloveRecording(path, images, topics[images].messages, start=start, stride=stride)


def _topics(path: Path) -> dict[str, _Topic]:
    """Return the topics that hold messages, of other kinds too."""
    summary = read_summary(path)
    if summary is None or summary.statistics is None:
        raise SourceError(f"{path}: does not say what it holds; 'mcap recover' mends such files")
    counts = summary.statistics.channel_message_counts
    topics: dict[str, _Topic] = {}
    for number, channel in summary.channels.items():
        if counts.get(number):
            schema = summary.schemas.get(channel.schema_id)
            before = topics.get(channel.topic, _Topic("", 0))
            topics[channel.topic] = _Topic(
                schema.name if schema else "", before.messages + counts[number]
            )
    return topics


def _image(schema: Schema | None, channel: Channel, message: Message) -> Stamped:
    match channel.message_encoding:
        case "json":
            fields = json.loads(message.data)
            stamp = fields["timestamp"]
            stamp_ns = stamp["sec"] * 1_000_000_000 + stamp["nsec"]
            data = base64.b64decode(fields["data"], validate=True)
        case "protobuf" if schema is not None:
            fields = parse_message(schema.name, schema.data, message.data)
            stamp_ns = fields.timestamp.ToNanoseconds()
            data = fields.data
        case encoding:
            raise FrameError(f"its encoding is {encoding!r}; give json or protobuf")
    return stamp_ns or message.log_time, data
