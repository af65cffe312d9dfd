"""A recording of ROS 1 or ROS 2 as a source of frames, without a ROS installation."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from ruamel.yaml import YAML

from placefield.errors import SourceError
from placefield_tools.common.natural_sort import in_natural_order
from placefield_tools.sources.mcap_messages import stamp_ns_of
from placefield_tools.sources.mcap_summary import read_summary
from placefield_tools.sources.recorded_images import IMAGES, Read, check_decoder, images_of
from placefield_tools.sources.recorded_poses import ROS_POSES
from placefield_tools.sources.recording import Recording, Stamped, known_errors
from placefield_tools.sources.ros_types import parser_of
from placefield_tools.sources.source import Span
from placefield_tools.sources.topics import Types, image_topic

_DEFINITIONS = {"ros2msg", "ros2idl", "omgidl", ""}  # schema encodings in MCAP that rosbags reads


class _RosRecording(Recording):
    poses = ROS_POSES

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        return messages_in_ros(self.path, topic)

    def _images(self) -> Iterator[Callable[[], Stamped]]:
        name = f"{self.path.name}:{self._topic}"
        with _reader(self.path) as reader:
            yield from images_of(name, self.types[self._topic], _messages(reader, self._topic))


def open_ros_recording(
    path: Path,
    topic: str | None,
    *,
    start: int,
    stride: int,
    stop: threading.Event | None,
) -> Recording:
    """Open a bag of ROS 1, a bag folder of ROS 2, or a file of such a folder (MCAP, SQLite).

    The memory that reading needs is checked only for chunks of MCAP, see ``read_summary``. Bags of
    ROS 1, and compressed messages and files of ROS 2, do not state it.

    Args:
        path: of the recording.
        topic: of images; None: the only one.
        start: index of the first frame.
        stride: step from one frame to the next.
        stop: ends the frames.

    Raises:
        SourceError: the recording cannot be read, has no such topic, or ends before ``start``.
    """
    with _checked_reader(path) as reader:
        held = _held(reader)
        types = _types(held)
        images = image_topic(str(path), types, IMAGES, topic)
        check_decoder(path, types[images])
        total = sum(each.msgcount for each in held if each.topic == images)
        span = Span(reader.start_time, reader.end_time)
        return _RosRecording(
            path, images, total, types, span, start=start, stride=stride, stop=stop
        )


def types_in_ros(path: Path) -> Types:
    """Return the topics that hold messages, and the types of these.

    Raises:
        SourceError: the recording cannot be read.
    """
    with _checked_reader(path) as reader:
        return _types(_held(reader))


def messages_in_ros(path: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the stamp, nanoseconds, and the message, for each message of a topic."""
    with _reader(path) as reader:
        for read in _messages(reader, topic):
            yield read()


@contextmanager
def _checked_reader(path: Path) -> Iterator[Reader1 | Reader2]:
    """Open a recording that can be read as a whole.

    Raises:
        SourceError: it cannot, or the block fails.
    """
    with known_errors(path):
        _check_files(path)
        with _reader(path) as reader:
            _check_listed(path)
            yield reader


def _held(reader: Reader1 | Reader2) -> list[Connection]:
    return [each for each in reader.connections if each.msgcount]


def _types(connections: Sequence[Connection]) -> Types:
    return {each.topic: each.msgtype for each in connections}


def _check_files(path: Path) -> None:
    """Refuse files that would be read only in part, or need too much memory."""
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        _check_no_log(file)
        if file.suffix.lower() == ".mcap":
            read_summary(file)


def _check_listed(folder: Path) -> None:
    """Refuse a bag folder whose files are not exactly those in its metadata.

    Raises:
        SourceError: a listed file is missing, or a file of messages is not listed.
    """
    if not folder.is_dir():
        return
    metadata = folder / "metadata.yaml"
    bag = YAML(typ="safe").load(metadata.read_text())["rosbag2_bagfile_information"]
    names = [Path(name).name for name in bag["relative_file_paths"]]
    if missing := [name for name in names if not (folder / name).is_file()]:
        raise SourceError(
            f"{metadata}: lists {', '.join(missing)}, which is missing: restore it, or leave it "
            f"out with: ros2 bag reindex {folder}"
        )
    listed = {name.removesuffix(".zstd") for name in names}
    held = (file.name for file in folder.iterdir() if file.suffix.lower() in (".db3", ".mcap"))
    if unlisted := [name for name in in_natural_order(held) if name not in listed]:
        raise SourceError(
            f"{metadata}: does not list {', '.join(unlisted)}, whose messages would be lost: "
            f"remove files of other drives, or run: ros2 bag reindex {folder}"
        )


def mixed_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag folder, if they hold other messages than ROS's, too.

    rosbags refuses such a folder; its files are read as single MCAP recordings.

    Raises:
        SourceError: a file is missing, or cannot be read.
    """
    if not path.is_dir():
        return []
    files = [path / name for name in in_natural_order(file.name for file in path.glob("*.mcap"))]
    with known_errors(path):
        if not any(map(_holds_others, files)):
            return []
        _check_listed(path)
    return files


def _holds_others(file: Path) -> bool:
    summary = read_summary(file)
    definitions = {each.encoding for each in summary.schemas.values()} if summary else set()
    return not definitions <= _DEFINITIONS


def _check_no_log(file: Path) -> None:
    """Refuse a database with a write-ahead log, which a killed recorder leaves."""
    log = file.with_name(f"{file.name}-wal")
    if file.suffix.lower() == ".db3" and log.is_file() and log.stat().st_size:
        raise SourceError(
            f"{log}: holds messages that are not in {file.name} yet: stop the recorder, or add "
            f"them with: sqlite3 {file.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        )


def _reader(path: Path) -> Reader1 | Reader2:
    return Reader1(path) if path.suffix.lower() == ".bag" else Reader2(path)


def _messages(reader: Reader1 | Reader2, topic: str) -> Iterator[Read]:
    """Yield a reader of each message of a topic."""
    is_ros1 = isinstance(reader, Reader1)
    connections = [each for each in reader.connections if each.topic == topic]
    for connection, recorded_ns, data in reader.messages(connections):
        yield partial(_read, connection, is_ros1, recorded_ns, data)


def _read(connection: Connection, is_ros1: bool, recorded_ns: int, data: bytes) -> tuple[int, Any]:
    parse = parser_of(
        connection.msgtype,
        connection.msgdef.data,
        is_idl=connection.msgdef.format == MessageDefinitionFormat.IDL,
        is_ros1=is_ros1,
    )
    message = parse(data)
    return stamp_ns_of(message) or recorded_ns, message
