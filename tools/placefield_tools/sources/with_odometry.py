"""A live source whose frames carry the odometry that the vehicle reports."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from placefield.features.frames import Frame
from placefield_tools.sources.source import Derived, Source


class WithOdometry(Derived):
    """The frames of a live source, with the metres travelled that the vehicle reported last."""

    count = None
    live = True

    def __init__(self, source: Source, metres: Callable[[], float | None]) -> None:
        """Wrap a source; ``metres`` gives the metres travelled, None without a new report."""
        super().__init__(source)
        self._metres = metres

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; a frame has no odometry if there was no report since the last one."""
        for frame in self._source:
            yield replace(frame, odometry_m=self._metres())
