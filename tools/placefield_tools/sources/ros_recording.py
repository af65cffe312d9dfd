"""A recording of ROS, 1 or 2, as a source of frames, with no ROS installed."""

import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from placefield.errors import SourceError
from placefield.ros.messages import IMAGES, image_of, stamp_of
from placefield_tools.sources.mcap_summary import read_summary
from placefield_tools.sources.recorded_poses import ROS_POSES
from placefield_tools.sources.recording import Recording, Stamped, known_errors
from placefield_tools.sources.source import Span
from placefield_tools.sources.topics import image_topic

_DEFINITIONS = {"ros2msg", "ros2idl", "omgidl", ""}  # how rosbags knows MCAP to define messages


class _RosRecording(Recording):
    poses = ROS_POSES

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        with _reader(self.path) as reader:
            for _, read in _messages(reader, topic):
                yield read()

    def _images(self) -> Iterator[Callable[[], Stamped]]:
        with _reader(self.path) as reader:
            for kind, read in _messages(reader, self._topic):
                yield partial(_image, kind, read)


def open_ros_recording(
    path: Path,
    topic: str | None,
    *,
    start: int,
    stride: int,
    stop: threading.Event | None,
) -> Recording:
    """Open a bag of ROS 1, a bag's folder of ROS 2, or one of its files (MCAP, SQLite).

    How much memory it takes is checked of MCAP's chunks alone (see ``read_summary``); of a bag of
    ROS 1, and of messages and files that ROS 2 compressed, nothing says so beforehand.

    Args:
        path: of the recording.
        topic: of images; None: the only one.
        start: the first frame.
        stride: from one frame to the next.
        stop: ends the frames.

    Raises:
        SourceError: it cannot be read, holds no such topic, or ends before ``start``.
    """
    with known_errors(path):
        _check_files(path)
    with known_errors(path), _reader(path) as reader:
        held = [each for each in reader.connections if each.msgcount]
        types = {each.topic: each.msgtype for each in held}
        images = image_topic(str(path), types, IMAGES, topic)
        total = sum(each.msgcount for each in held if each.topic == images)
        span = Span(reader.start_time, reader.end_time)
        return _RosRecording(
            path, images, total, types, span, start=start, stride=stride, stop=stop
        )


def _check_files(path: Path) -> None:
    """Refuse MCAP files that rosbags would fail at, or take too much memory for."""
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if file.suffix.lower() != ".mcap":
            continue
        summary = read_summary(file)
        definitions = {each.encoding for each in summary.schemas.values()} if summary else set()
        if foreign := sorted(definitions - _DEFINITIONS):
            raise SourceError(
                f"{file}: holds messages defined by {', '.join(foreign)}, and topics of ROS are "
                "read from a file of their own only; record them into one"
            )


def _reader(path: Path) -> AnyReader:
    """Make a reader; a recording from before ROS 2 Iron does not say what its messages are."""
    return AnyReader([path], default_typestore=get_typestore(Stores.LATEST))


def _messages(reader: AnyReader, topic: str) -> Iterator[tuple[str, Callable[[], tuple[int, Any]]]]:
    """Yield the type of each message of a topic, and what reads its stamp and itself."""
    connections = [each for each in reader.connections if each.topic == topic]
    for connection, recorded_ns, data in reader.messages(connections):
        kind = connection.msgtype
        yield kind, partial(_read, reader, kind, recorded_ns, data)


def _read(reader: AnyReader, kind: str, recorded_ns: int, data: bytes) -> tuple[int, Any]:
    message: Any = reader.deserialize(data, kind)
    return stamp_of(message) or recorded_ns, message


def _image(kind: str, read: Callable[[], tuple[int, Any]]) -> Stamped:
    stamp_ns, message = read()
    return stamp_ns, image_of(kind, message)
