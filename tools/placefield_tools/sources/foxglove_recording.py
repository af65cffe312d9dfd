"""An MCAP recording of Foxglove's messages as a source of frames."""

import base64
import json
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema

from placefield.errors import SourceError
from placefield.ros.messages import IMAGES as ROS_IMAGES
from placefield_tools.sources.mcap_summary import read_summary, span_of
from placefield_tools.sources.protobuf_messages import parse_message
from placefield_tools.sources.recorded_poses import FOXGLOVE_POSES
from placefield_tools.sources.recording import Recording, Stamped, known_errors
from placefield_tools.sources.source import Span
from placefield_tools.sources.topics import image_topic

_IMAGE = "foxglove.CompressedImage"


class _Topic(NamedTuple):
    kind: str
    messages: int


class _FoxgloveRecording(Recording):
    poses = FOXGLOVE_POSES

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        return (read() for read in _messages(self.path, topic))

    def _images(self) -> Iterator[Callable[[], Stamped]]:
        for read in _messages(self.path, self._topic):
            yield partial(_image, read)


def holds_foxglove_images(path: Path, topic: str | None) -> bool:
    """Return whether an MCAP file's images are Foxglove's, and not of ROS.

    Args:
        path: of the file.
        topic: of images; None: any.

    Raises:
        SourceError: it cannot be read.
    """
    with known_errors(path):
        topics, _ = _contents(path)
    is_of_ros = topic in topics and topics[topic].kind in ROS_IMAGES
    return not is_of_ros and any(each.kind == _IMAGE for each in topics.values())


def open_foxglove_recording(
    path: Path,
    topic: str | None,
    *,
    start: int,
    stride: int,
    stop: threading.Event | None,
) -> Recording:
    """Open an MCAP file with ``foxglove.CompressedImage``, as JSON or protobuf.

    Args:
        path: of the file.
        topic: of images; None: the only one.
        start: the first frame.
        stride: from one frame to the next.
        stop: ends the frames.

    Raises:
        SourceError: it cannot be read, holds no such topic, or ends before ``start``.
    """
    with known_errors(path):
        topics, span = _contents(path)
    types = {name: held.kind for name, held in topics.items()}
    images = image_topic(str(path), types, (_IMAGE, *ROS_IMAGES), topic)
    total = topics[images].messages
    return _FoxgloveRecording(
        path, images, total, types, span, start=start, stride=stride, stop=stop
    )


def _contents(path: Path) -> tuple[dict[str, _Topic], Span]:
    """Return the topics that hold messages, of other kinds too, and when they were recorded."""
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
    return topics, span_of(summary)


def _messages(path: Path, topic: str) -> Iterator[Callable[[], tuple[int, Any]]]:
    """Yield what reads the stamp of a message and itself, for each of a topic."""
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages([topic]):
            yield partial(_read, schema, channel, message)


def _read(schema: Schema | None, channel: Channel, message: Message) -> tuple[int, Any]:
    match channel.message_encoding:
        case "json":
            fields = json.loads(message.data, object_hook=lambda each: SimpleNamespace(**each))
            stamp_ns = fields.timestamp.sec * 1_000_000_000 + fields.timestamp.nsec
        case "protobuf" if schema is not None:
            fields = parse_message(schema.name, schema.data, message.data)
            stamp_ns = fields.timestamp.ToNanoseconds()
        case encoding:
            raise SourceError(
                f"{channel.topic}: its messages are of encoding {encoding!r}; give json or protobuf"
            )
    return stamp_ns or message.log_time, fields


def _image(read: Callable[[], tuple[int, Any]]) -> Stamped:
    stamp_ns, message = read()
    data = message.data
    return stamp_ns, base64.b64decode(data, validate=True) if isinstance(data, str) else data
