"""Which frames of a drive are taken, when they are spaced by odometry."""

import math

from placefield.errors import SourceError

_ROUNDING_M = 1e-6  # so that 0.7 is on the grid of 0.1


class DistanceSampler:
    """Takes the first frame, and the first one at or behind each multiple of so many metres.

    This is the paper's odometry, which triggers the camera by distance, so that the vehicle's speed
    and its stops do not show in the frames.

    A frame is taken late by up to the way between two frames, but this does not add up: what is due
    is on a grid, so that the numbers of the frames of two drives stay together. A gap of several
    multiples gives one frame.
    """

    def __init__(self, metres: float) -> None:
        self._metres = metres
        self._first_m: float | None = None
        self._due_m = -math.inf

    def is_due(self, odometry_m: float) -> bool:
        """Whether the next frame is taken, which was made after so many metres."""
        if self._first_m is None:
            self._first_m = odometry_m
        travelled_m = odometry_m - self._first_m + _ROUNDING_M
        if travelled_m < self._due_m:
            return False
        self._due_m = self._metres * (math.floor(travelled_m / self._metres) + 1)
        return True


def check_spacing(metres: float) -> float:
    """Return a spacing, which a user gave.

    Raises:
        SourceError: it is no distance above 0.
    """
    if not (math.isfinite(metres) and metres > _ROUNDING_M):
        raise SourceError(f"--spacing {metres:g}: must be a distance above 0 metres")
    return metres
