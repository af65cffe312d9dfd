"""A live source's frames, with the odometry that the vehicle tells of at the time."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from placefield.features.frames import Frame
from placefield_tools.sources.source import Source


class Metered(Source):
    """The frames of a live source from the vehicle's first word on, with the metres travelled."""

    count = None
    live = True

    def __init__(self, source: Source, metres: Callable[[], float | None]) -> None:
        """Take the source, and what tells the metres travelled, None while it is not known."""
        self._source = source
        self._metres = metres

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; those before the first word have no place on the way."""
        for frame in self._source:
            metres = self._metres()
            if metres is not None:
                yield replace(frame, odometry_m=metres)

    def close(self) -> None:
        """Give back what the source holds."""
        self._source.close()
