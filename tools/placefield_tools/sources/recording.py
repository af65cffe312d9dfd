"""What recordings have in common, whoever wrote them."""

import threading
from abc import abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
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

_REASON = 150  # characters

Stamped = tuple[int, bytes | NDArray[np.uint8]]
"""A stamp in nanoseconds and an image."""


class Recording(Source):
    """The images of one topic, by their own stamps, or the recorder's where they have none.

    Attributes:
        path: of the recording.
        types: its topics, and the types of their messages.
        poses: the types that tell where the vehicle is, as its writer calls them.
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
        """Take a recording of these topics, whose ``topic`` holds ``total`` images."""
        self._stop = stop
        chosen = range(start, total, stride)
        if not chosen:
            raise SourceError(f"--start {start}: {path}: {topic} holds {total} frames only")
        self.count = len(chosen)
        self.types, self.span = types, span
        self.path = path
        self._topic = topic
        self._start = start
        self._stride = stride

    @abstractmethod
    def _images(self) -> Iterator[Callable[[], Stamped]]:
        """Yield what decodes an image, for each of the topic."""

    @abstractmethod
    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield the messages of a topic, each behind its stamp in ns."""

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; those before ``start`` and between are not decoded."""
        with known_errors(self.path):
            images = enumerate(until(self._stop, self._images()))
            for index, decode in islice(images, self._start, None, self._stride):
                name = f"{self.path.name}#{index}"
                try:
                    stamp_ns, image = decode()
                except FrameError as error:
                    raise SourceError(f"{name}: {error}") from None
                yield Frame(index, stamp_ns, name, image)


@contextmanager
def known_errors(path: Path) -> Iterator[None]:
    """Make one line of whatever a reader stumbles over in a damaged recording.

    Readers of recordings raise what comes up: struct.error, KeyError, AssertionError, …
    """
    try:
        yield
    except PlacefieldError:
        raise
    except Exception as error:
        reason = shorten(str(error) or type(error).__name__, _REASON, placeholder=" …")
        question = "; was it cut off?" if is_cut_off(path) else ""
        raise SourceError(f"{path}: cannot be read as a recording ({reason}){question}") from error
