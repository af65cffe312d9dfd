"""The interface of all sources of frames."""

import threading
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import takewhile
from types import TracebackType
from typing import NamedTuple, Self, TypeVar

from placefield.features.calibration import Calibration
from placefield.features.frames import Frame
from placefield.maps.geography import Origin

T = TypeVar("T")


class Span(NamedTuple):
    """The time of a recording: first and last stamp, nanoseconds."""

    first_ns: int
    last_ns: int


class Source(ABC):
    """A stream of frames: iterate over it inside a ``with``.

    A frame that cannot be read is yielded with a ``fault``. The ``index`` of a frame counts all of
    the source, including those that start, stride and spacing leave out. A source that is not live
    can be iterated again, and gives the same frames.

    Attributes:
        live: whether the source runs on, like a camera, even if its frames are not read.
        count: number of frames, None if unknown; an estimate for a video, because its container may
            be wrong.
        origin: georeference of the poses, None if unknown.
        stamped: whether the stamps are measured; if not, they are nominal, at a constant rate.
        span: time of the recording, None if unknown.
        dimensions: of the descriptors that the frames are; None: the frames are images.
        calibration: of the camera that took the frames; None if unknown.
    """

    live: bool = False
    count: int | None
    origin: Origin | None = None
    stamped: bool = True
    span: Span | None = None
    dimensions: int | None = None
    calibration: Calibration | None = None

    @cached_property
    def not_given(self) -> Counter[str]:
        """Numbers of frames that were not yielded, after a complete iteration.

        ``missing`` frames were announced and not found; ``left out`` ones have no pose.
        """
        return Counter()

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order; raise SourceError if the source fails."""

    def close(self) -> None:  # noqa: B027 - only a source that holds a device needs it
        """Release what the source holds."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class Derived(Source):
    """Base class of sources that change or leave out frames of another source."""

    def __init__(self, source: Source) -> None:
        """Wrap another source, which is closed with this one."""
        self._source = source
        self.live = source.live
        self.origin = source.origin
        self.stamped = source.stamped
        self.span = source.span
        self.dimensions = source.dimensions
        self.calibration = source.calibration
        self.not_given = source.not_given

    def close(self) -> None:
        """Close the other source."""
        self._source.close()


class Ended(Derived):
    """The frames of a source before a last index."""

    def __init__(self, source: Source, start: int, stop: int, stride: int) -> None:
        """Wrap a source of frames ``start``, ``start + stride``, …; yield those before ``stop``."""
        super().__init__(source)
        self._stop = stop
        most = len(range(start, stop, stride))
        self.count = most if source.count is None else min(most, source.count)

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames."""
        return takewhile(lambda frame: frame.index < self._stop, self._source)


def until(stop: threading.Event | None, items: Iterable[T]) -> Iterator[T]:
    """Yield the items until the event is set, if there is one."""
    return takewhile(lambda _: stop is None or not stop.is_set(), items)
