"""A pose in the plane: a point and a heading."""

from typing import NamedTuple


class Pose(NamedTuple):
    """The pose of a frame: x and y in metres, yaw in radians, in the user's own map frame."""

    x: float
    y: float
    yaw: float
