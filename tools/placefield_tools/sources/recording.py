"""The common base of recordings as sources of frames."""

import logging
import threading
from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError, PlacefieldError, SourceError
from placefield.features.frames import Frame
from placefield_tools.sources.cut_off import is_cut_off
from placefield_tools.sources.source import Source, Span, until
from placefield_tools.sources.topics import Types

log = logging.getLogger(__name__)

_REASON = 150  # characters

_MENDED_BY = {
    ".bag": "'rosbag reindex'",
    ".db3": "'.recover' of sqlite3",
    ".mcap": "'mcap recover'",
}

Stamped = tuple[int, bytes | NDArray[np.uint8] | FrameError]
"""A stamp in nanoseconds, and an image or the reason why there is none."""


class Recording(Source):
    """The images of one topic; an image without a stamp gets the recorder's.

    Attributes:
        path: of the recording.
        types: its topics, and the types of their messages.
        poses: the types of messages that hold poses, by their names in this kind of recording.
    """

    poses: tuple[str, ...]

    def __init__(
        self,
        path: Path,
        topic: str,
        total: int,
        types: Types,
        span: Span,
        *,
        start: int,
        stride: int,
        stop: threading.Event | None,
    ) -> None:
        """Initialise a recording whose ``topic`` holds ``total`` images.

        Raises:
            SourceError: the topic ends before ``start``.
        """
        self._stop = stop
        self._total = total
        self._start, self._stride = start, stride
        self.count = len(range(start, total, stride))
        if not self.count:
            raise SourceError(f"--start {start}: {path}: {topic} holds only {total} frames")
        self.types, self.span = types, span
        self.path = path
        self._topic = topic

    @abstractmethod
    def _images(self) -> Iterator[Callable[[], Stamped]]:
        """Yield a decoder of each image of the topic."""

    @abstractmethod
    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield the stamp, nanoseconds, and the message, for each message of a topic."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; frames that are not selected are not decoded.

        A message that cannot be parsed becomes a frame with a ``fault``, with the stamp of the
        frame before.
        """
        index, stamp_ns = -1, 0
        with known_errors(self.path):
            for index, decode in enumerate(until(self._stop, self._images())):
                if index >= self._start and (index - self._start) % self._stride == 0:
                    stamp_ns, image = _decoded(decode, stamp_ns)
                    name = f"{self.path.name}#{index}"
                    if isinstance(image, FrameError):
                        yield Frame(index, stamp_ns, name, b"", fault=str(image))
                    else:
                        yield Frame(index, stamp_ns, name, image)
        if not (self._stop and self._stop.is_set()):
            self._note_missing(max(0, self._total - index - 1))

    def _note_missing(self, missing: int) -> None:
        self.not_given["missing"] = missing
        if missing:
            log.warning(
                "%s: should hold %d images on %s, and %d of them are missing",
                self.path,
                self._total,
                self._topic,
                missing,
            )


def _decoded(decode: Callable[[], Stamped], before_ns: int) -> Stamped:
    try:
        return decode()
    except PlacefieldError:
        raise
    except Exception as error:  # parsers raise errors of any kind
        return before_ns, FrameError(f"the message cannot be parsed ({_short(error)})")


@contextmanager
def known_errors(path: Path) -> Iterator[None]:
    """Turn any error of a reader of a damaged recording into a ``SourceError`` of one line.

    Such readers raise errors of any kind: struct.error, KeyError, AssertionError, …
    """
    try:
        yield
    except PlacefieldError:
        raise
    except Exception as error:
        reason = _short(error)
        question = "; was it cut off?" if is_cut_off(path) else ""
        raise SourceError(
            f"{path}: cannot be read as a recording ({reason}){question}{_remedy(path)}"
        ) from error


def _remedy(path: Path) -> str:
    """Return a hint to the command that repairs a damaged recording, by its files' suffixes."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    mended_by = [_MENDED_BY[suffix] for file in files if (suffix := file.suffix) in _MENDED_BY]
    return f"; if it is damaged, try {mended_by[0]}" if mended_by else ""


def _short(error: Exception) -> str:
    return shorten(str(error) or type(error).__name__, _REASON, placeholder=" …")
