"""What every source of frames offers."""

import threading
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import takewhile
from types import TracebackType
from typing import NamedTuple, Self, TypeVar

from placefield.features.frames import Frame
from placefield.maps.geography import Origin

T = TypeVar("T")


class Span(NamedTuple):
    """From when to when something was recorded, nanoseconds, both included."""

    first_ns: int
    last_ns: int


class Source(ABC):
    """A stream of frames: iterate over it inside a ``with``.

    ``live`` tells a source that runs on whether or not its frames are taken. ``count`` is how many
    frames it gives, None where that is unknown; a video's container may be wrong about it, so there
    it is an estimate. ``origin`` is where on earth the poses' frame lies, None where that is
    unknown. ``stamped`` tells whether the frames' stamps are their own; where nobody knows when
    they were taken, they are as if of a steady rate. ``span`` is from when to when it was recorded,
    None where nobody wrote that down.

    A frame that cannot be read is given all the same, with its ``fault``. ``not_given`` counts the
    others, when it has been iterated to its end: those ``missing``, which it has promised and not
    found, and those ``left out``, which have no place.

    A frame's ``index`` counts all the source's frames, those before ``start`` and those that stride
    and spacing leave out too. A source that is not live can be iterated again, with the same
    frames.
    """

    live: bool = False
    count: int | None
    origin: Origin | None = None
    stamped: bool = True
    span: Span | None = None

    @cached_property
    def not_given(self) -> Counter[str]:
        """How many frames it has not given, by what is the matter with them."""
        return Counter()

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order; raise SourceError where the source fails on the way."""

    def close(self) -> None:  # noqa: B027 - only a source that holds a device has to
        """Give back what the source holds."""

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
    """Root of sources that change, or leave out, frames of another."""

    def __init__(self, source: Source) -> None:
        """Take the other, which is given back with this one."""
        self._source = source
        self.live = source.live
        self.origin = source.origin
        self.stamped = source.stamped
        self.span = source.span
        self.not_given = source.not_given

    def close(self) -> None:
        """Give back what the source holds."""
        self._source.close()


class Ended(Derived):
    """The frames of a source up to one."""

    def __init__(self, source: Source, start: int, stop: int, stride: int) -> None:
        """Take a source of frames ``start``, ``start + stride``, …; give those before ``stop``."""
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
