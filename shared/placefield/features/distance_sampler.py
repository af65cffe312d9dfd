"""Sampling of the frames of a drive at equal distances, by odometry."""

import math

from placefield.errors import SourceError

_ROUNDING_M = 1e-6  # so that 0.7 is on the grid of 0.1


class DistanceSampler:
    """Selects the first frame, and the first frame at or after each multiple of ``metres``.

    This corresponds to the paper's odometry, which triggers the camera by distance, so that the
    vehicle's speed and its stops have no effect on the frames.

    A selected frame may be late by up to the distance between two frames. Such delays do not add
    up, because the distances are on a fixed grid: frame i of two drives stays at the same place. A
    gap of several multiples gives one frame.
    """

    def __init__(self, metres: float) -> None:
        self._metres = metres
        self._first_m: float | None = None
        self._due_m = -math.inf

    def is_due(self, odometry_m: float) -> bool:
        """Return whether the next frame, at this odometry in metres, is selected."""
        if self._first_m is None:
            self._first_m = odometry_m
        travelled_m = odometry_m - self._first_m + _ROUNDING_M
        if travelled_m < self._due_m:
            return False
        self._due_m = self._metres * (math.floor(travelled_m / self._metres) + 1)
        return True


def check_spacing(metres: float) -> float:
    """Return a spacing in metres that a user gave, after a check.

    Raises:
        SourceError: it is not a finite distance above 0.
    """
    if not (math.isfinite(metres) and metres > _ROUNDING_M):
        raise SourceError(f"--spacing {metres:g}: must be a distance above 0 metres")
    return metres
