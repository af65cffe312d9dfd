"""A live source's frames, with the odometry that the vehicle tells of at the time."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from placefield.features.frames import Frame
from placefield_tools.sources.source import Derived, Source


class Metered(Derived):
    """The frames of a live source, with the metres travelled, where the vehicle has told them."""

    count = None
    live = True

    def __init__(self, source: Source, metres: Callable[[], float | None]) -> None:
        """Take the source, and what tells the metres travelled, None if that is no news."""
        super().__init__(source)
        self._metres = metres

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; those with no word since the one before have no odometry."""
        for frame in self._source:
            yield replace(frame, odometry_m=self._metres())
