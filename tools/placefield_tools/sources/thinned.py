"""A source thinned to every n-th frame."""

from collections.abc import Iterator
from itertools import islice

from placefield.features.frames import Frame
from placefield_tools.sources.source import Derived, Source


class Thinned(Derived):
    """Every n-th frame of a source that is not live, the first one on.

    Unlike a stride, which a source has itself, it counts what the source gives: of a source that is
    spaced, the spaced frames.

    Attributes:
        unthinned_count: how many frames the source has.
    """

    def __init__(self, source: Source, every: int, unthinned_count: int) -> None:
        super().__init__(source)
        self._every = every
        self.unthinned_count = unthinned_count
        self.count: int = len(range(0, unthinned_count, every))

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError where the source fails on the way."""
        return islice(iter(self._source), 0, None, self._every)
