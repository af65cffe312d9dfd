"""Odometry: how far the vehicle moved from frame to frame, on a map that knows its own metres.

With odometry no speed is too high.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import RESOLVED, SPEEDS
from placefield.matching.roads import RouteCells

Vector = NDArray[np.float64]

_UNEVEN = 0.5  # deviation of a pace that is assumed, as a fraction of it
_ASSUMED = 10  # so many frames without a reading keep the last pace


class Displacement(NamedTuple):
    """How far the vehicle moved from one frame to the next, in metres.

    Attributes:
        metres: the distance; negative if the vehicle travelled less than was assumed so far.
        deviation: of an assumed distance; 0 for a measured one.
        pace: latest metres per frame.
        is_measured: whether both frames had a reading.
    """

    metres: float
    deviation: float
    pace: float
    is_measured: bool


def measures_length(displacement: Displacement, cells: RouteCells) -> bool:
    """Whether the step after this displacement can be compared with steps of the map."""
    return displacement.is_measured and displacement.pace <= SPEEDS[RESOLVED - 1] * cells.spacing


class Odometer:
    """Turns the readings of an odometer, which may be missing, into displacements of frames."""

    def __init__(self) -> None:
        """Begin a drive."""
        self._forget(None)

    def _forget(self, reading: float | None) -> None:
        self._last, self._pace = reading, None
        self._assumed, self._frames = 0.0, 0

    _last: float | None
    _pace: float | None

    def displacement(self, reading: float | None) -> Displacement | None:
        """Return the displacement from the last frame to the next one, whose reading this is.

        For a frame without a reading, the last pace is assumed for a while. The next reading
        corrects the error of the assumption. None if nothing is known: at first, and where the
        odometer began anew.
        """
        self._frames += 1
        if reading is None:
            return self._assume()
        if self._last is None or reading < self._last:
            self._forget(reading)
            return None
        travelled, frames = reading - self._last, self._frames
        rest = travelled - self._assumed
        self._last, self._pace = reading, travelled / frames
        self._assumed, self._frames = 0.0, 0
        return Displacement(rest, 0.0, travelled / frames, is_measured=frames == 1)

    def _assume(self) -> Displacement | None:
        if self._pace is None or self._frames > _ASSUMED:
            self._forget(None)
            return None
        self._assumed += self._pace
        return Displacement(self._pace, _UNEVEN * self._pace, self._pace, is_measured=False)


def speeds_of(pace: float) -> Vector:
    """Return the distribution over ``SPEEDS``, (S,), of a vehicle at this pace in places per frame.

    It lies between two of the speeds, and is never faster than the map resolves, because odometry
    resolves the displacement.
    """
    resolved = SPEEDS[:RESOLVED]
    pace = min(pace, resolved[-1])
    above = max(int(np.searchsorted(resolved, pace)), 1)
    share = (pace - resolved[above - 1]) / (resolved[above] - resolved[above - 1])
    distribution = np.zeros(len(SPEEDS))
    distribution[above - 1 : above + 1] = 1 - share, share
    return distribution
