"""The line a street follows: from metres along it and beside it to points in the world."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

STEP = 0.5  # metres between samples of the centre line
LEAD = 15.0  # metres of street behind the first frame


@dataclass(frozen=True)
class Route:
    """Centre line of a street, sampled every `STEP` metres from `-LEAD` on.

    Attributes:
        arc: metres along the line, float64 (N,); the first frame is taken at 0.
        x: metres east, float64 (N,).
        y: metres north, float64 (N,).
        yaw: heading in radians, counter-clockwise from east, float64 (N,).
    """

    arc: NDArray[np.float64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    yaw: NDArray[np.float64]

    def heading(self, arc: ArrayLike) -> NDArray[np.float64]:
        """Return the yaw of the line in radians at `arc` metres, shape of `arc`."""
        return np.interp(np.asarray(arc, dtype=np.float64), self.arc, self.yaw)

    def point(
        self, arc: ArrayLike, offset: ArrayLike = 0.0, height: ArrayLike = 0.0
    ) -> NDArray[np.float64]:
        """Return the world points (..., 3) that lie `offset` metres left of the line at `arc`.

        The arguments are in metres and broadcast against each other.
        """
        arc, offset, height = np.broadcast_arrays(arc, offset, height)
        yaw = self.heading(arc)
        point = np.empty((*arc.shape, 3))
        point[..., 0] = np.interp(arc, self.arc, self.x) - offset * np.sin(yaw)
        point[..., 1] = np.interp(arc, self.arc, self.y) + offset * np.cos(yaw)
        point[..., 2] = height
        return point


def make_route(seed: int, length: float) -> Route:
    """Return a gently winding route of `length` metres beyond the first frame.

    The heading is a sum of two sines whose phases come from `seed`, so that a longer route of the
    same seed begins like a shorter one.
    """
    rng = np.random.default_rng([seed, 1])
    arc = np.arange(-LEAD, length + STEP, STEP)
    yaw = np.zeros_like(arc)
    for amplitude, wavelength in ((0.26, 210.0), (0.10, 83.0)):
        yaw += amplitude * np.sin(2 * np.pi * arc / wavelength + rng.uniform(0, 2 * np.pi))
    x = np.cumsum(np.cos(yaw)) * STEP
    y = np.cumsum(np.sin(yaw)) * STEP
    return Route(arc, x - np.interp(0, arc, x), y - np.interp(0, arc, y), yaw)
