"""An MCAP recording of ROS or Foxglove messages as a source of frames."""

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import make_reader

from placefield.errors import PlacefieldError, SourceError
from placefield_tools.common.natural_sort import counted
from placefield_tools.sources.damaged_chunks import messages_by_chunk
from placefield_tools.sources.mcap_messages import kind_of, read_message
from placefield_tools.sources.mcap_summary import read_summary, span_of
from placefield_tools.sources.recorded_images import IMAGES, Read, check_decoder, images_of
from placefield_tools.sources.recorded_poses import FOXGLOVE_POSES, ROS_POSES
from placefield_tools.sources.recording import Recording, Stamped, known_errors
from placefield_tools.sources.source import Span
from placefield_tools.sources.topics import Types, image_topic

log = logging.getLogger(__name__)


class _Topic(NamedTuple):
    kind: str
    messages: int


class _McapRecording(Recording):
    poses = (*ROS_POSES, *FOXGLOVE_POSES)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        return messages_in_mcap(self.path, topic)

    def _images(self) -> Iterator[Callable[[], Stamped]]:
        name = f"{self.path.name}:{self._topic}"
        return images_of(name, self.types[self._topic], _messages(self.path, self._topic))


def open_mcap_recording(
    path: Path,
    topic: str | None,
    *,
    start: int,
    stride: int,
    stop: threading.Event | None,
) -> Recording:
    """Open an MCAP file with images of ROS 1 or 2 or Foxglove; other topics may hold anything.

    Args:
        path: of the file.
        topic: of images; None: the only one.
        start: index of the first frame.
        stride: step from one frame to the next.
        stop: ends the frames.

    Raises:
        SourceError: the file cannot be read, has no such topic, or ends before ``start``.
        ConfigError: the images are video, and PyAV is not installed.
    """
    with known_errors(path):
        topics, span = _contents(path)
    types = _types(topics)
    images = image_topic(str(path), types, IMAGES, topic)
    check_decoder(path, types[images])
    total = topics[images].messages
    return _McapRecording(path, images, total, types, span, start=start, stride=stride, stop=stop)


def types_in_mcap(path: Path) -> Types:
    """Return the topics that hold messages, and the types of these.

    Raises:
        SourceError: the file cannot be read.
    """
    with known_errors(path):
        topics, _ = _contents(path)
    return _types(topics)


def messages_in_mcap(path: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """Yield the stamp, nanoseconds, and the fields, for each message of a topic.

    Messages that cannot be parsed are left out; their number is logged.
    """
    left_out = 0
    for read in _messages(path, topic):
        try:
            message = read()
        except PlacefieldError:
            raise
        except Exception:  # parsers raise errors of any kind
            left_out += 1
            continue
        yield message
    if left_out:
        log.warning(
            "%s: %s on %s cannot be parsed: left out", path, counted(left_out, "message"), topic
        )


def lists_topics(path: Path) -> bool:
    """Return whether a file is MCAP, and its summary lists its topics; a writer may leave it out.

    Raises:
        SourceError: the file cannot be read.
    """
    if path.suffix.lower() != ".mcap":
        return False
    with known_errors(path):
        summary = read_summary(path)
    return summary is None or summary.statistics is None or bool(summary.channels)


def _types(topics: Mapping[str, _Topic]) -> Types:
    return {name: held.kind for name, held in topics.items()}


def _contents(path: Path) -> tuple[dict[str, _Topic], Span]:
    """Return all topics that hold messages, and from when to when they were recorded."""
    summary = read_summary(path)
    if summary is None or summary.statistics is None:
        raise SourceError(f"{path}: has no summary of its content; repair it with 'mcap recover'")
    counts = summary.statistics.channel_message_counts
    topics: dict[str, _Topic] = {}
    for number, channel in summary.channels.items():
        if counts.get(number):
            kind = kind_of(summary.schemas.get(channel.schema_id))
            before = topics.get(channel.topic, _Topic(kind, 0))
            topics[channel.topic] = _Topic(kind, before.messages + counts[number])
    return topics, span_of(summary)


def _messages(path: Path, topic: str) -> Iterator[Read]:
    """Yield a reader of each message of a topic; after damage, chunk by chunk."""
    yielded = 0
    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages([topic])
        while True:
            try:
                schema, channel, message = next(messages)
            except StopIteration:
                return
            except Exception:  # a damaged file raises errors of any kind
                break
            yielded += 1
            yield partial(read_message, schema, channel, message)
    yield from islice(messages_by_chunk(path, topic), yielded, None)
