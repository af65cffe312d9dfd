"""A source's frames at equal distances along the way, by odometry."""

import math
from collections.abc import Iterator

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield.maps.trajectory import MAX_GAP_NS
from placefield_tools.sources.located import Located
from placefield_tools.sources.source import Source

_ROUNDING_M = 1e-6  # so that 0.7 is on the grid of 0.1


class Spaced(Source):
    """The first frame, and the first one at or behind each multiple of so many metres from there.

    This is the paper's odometry, which triggers the camera by distance, so that the vehicle's speed
    and its stops do not show in the frames.

    A frame is given late by up to the way between two frames of the source, but this does not add
    up: what is due is on a grid, so that the numbers of the frames of two drives stay together. A
    gap of several multiples gives one frame.
    """

    count = None

    def __init__(self, source: Source, metres: float) -> None:
        self._source = source
        self._metres = metres
        self.live = source.live
        self.origin = source.origin

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError at one that has no odometry."""
        first_m, due_m = 0.0, -math.inf
        for number, frame in enumerate(self._source):
            if frame.odometry_m is None:
                raise SourceError(
                    f"{frame.name}: has no odometry to space frames by; "
                    f"leave --spacing out, or {self._remedy()}"
                )
            if number == 0:
                first_m = frame.odometry_m
            travelled_m = frame.odometry_m - first_m + _ROUNDING_M
            if travelled_m >= due_m:
                due_m = self._metres * (math.floor(travelled_m / self._metres) + 1)
                yield frame

    def _remedy(self) -> str:
        if isinstance(self._source, Located):
            return f"give poses that are at most {MAX_GAP_NS / 1e9:g} s apart there"
        return "give a frames.csv with the column odometry, --odometry-topic or --poses"

    def close(self) -> None:
        """Give back what the source holds."""
        self._source.close()
