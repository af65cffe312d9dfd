"""A source thinned to every n-th frame."""

from collections.abc import Iterator
from itertools import islice

from placefield.features.frames import Frame
from placefield_tools.sources.source import Derived, Source


class Thinned(Derived):
    """Every n-th frame of a source that is not live, from the first on.

    A stride counts all frames of a source. This class counts the frames that the source yields, for
    example after distance sampling.

    Attributes:
        unthinned_count: number of frames of the source.
    """

    def __init__(self, source: Source, every: int, unthinned_count: int) -> None:
        super().__init__(source)
        self._every = every
        self.unthinned_count = unthinned_count
        self.count: int = len(range(0, unthinned_count, every))

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError if the source fails."""
        return islice(iter(self._source), 0, None, self._every)
