"""A pinhole camera that looks level along a street, and what of the world it sees."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

WIDTH = 640  # pixels; frames are drawn at twice their size and reduced, which smooths all edges
HEIGHT = 480
FOCAL = 450.0  # pixels: 71 degrees across
CENTRE = WIDTH / 2
HORIZON = 284.0  # row; below the middle, as if the lens were shifted up, so that walls stay upright
EYE = 1.6  # metres above the road
NEAR = 0.7  # metres; nothing nearer is drawn


@dataclass(frozen=True)
class PinholeCamera:
    """A camera at `position` (3,) in metres, level, with heading `yaw` in radians."""

    position: NDArray[np.float64]
    yaw: float

    @cached_property
    def forward(self) -> NDArray[np.float64]:
        """Unit vector (3,) along the optical axis."""
        return np.array([np.cos(self.yaw), np.sin(self.yaw), 0.0])

    @cached_property
    def right(self) -> NDArray[np.float64]:
        """Unit vector (3,) to the right of the image."""
        return np.array([np.sin(self.yaw), -np.cos(self.yaw), 0.0])

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """Matrix (3, 3) from a world point relative to the camera to homogeneous pixels.

        The third coordinate is the depth in metres.
        """
        up = np.array([0.0, 0.0, 1.0])
        return np.stack(
            [
                FOCAL * self.right + CENTRE * self.forward,
                -FOCAL * up + HORIZON * self.forward,
                self.forward,
            ]
        )

    def project(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return pixels (N, 2) and depths in metres (N,) of world points (N, 3).

        Pixels mean something only where the depth is positive.
        """
        homogeneous = (points - self.position) @ self.matrix.T
        depth = homogeneous[:, 2]
        return homogeneous[:, :2] / np.where(depth > 0, depth, 1.0)[:, None], depth

    def homography(
        self,
        origin: NDArray[np.float64],
        along: NDArray[np.float64],
        up: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the map (3, 3) from (a, b, 1) to the pixel of `origin + a along + b up`."""
        columns = np.array([along, up, origin - self.position]).T
        return np.asarray(self.matrix @ columns)
