"""A source thinned to every n-th frame."""

from collections.abc import Iterator
from itertools import islice

from placefield.features.frames import Frame
from placefield_tools.sources.source import Source


class Thinned(Source):
    """Every n-th frame of a source that is not live, the first one on.

    Unlike a stride, which a source has itself, it counts what the source gives: of a source that is
    spaced, the spaced frames.

    Attributes:
        unthinned_count: how many frames the source has.
    """

    def __init__(self, source: Source, every: int, unthinned_count: int) -> None:
        self._source = source
        self._every = every
        self.unthinned_count = unthinned_count
        self.count: int = len(range(0, unthinned_count, every))
        self.origin = source.origin
        self.stamped = source.stamped

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError where the source fails on the way."""
        return islice(iter(self._source), 0, None, self._every)

    def close(self) -> None:
        """Give back what the source holds."""
        self._source.close()
