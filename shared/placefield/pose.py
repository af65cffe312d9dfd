"""Where something is: a point and a heading in the plane."""

from typing import NamedTuple


class Pose(NamedTuple):
    """Where a frame was taken: x and y in metres, yaw in radians, in the user's own map frame."""

    x: float
    y: float
    yaw: float
