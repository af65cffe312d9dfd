"""What is known of a folder's frames before their images are read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from placefield.features.frames import Pose
from placefield.maps.geography import Origin
from placefield.maps.trajectory import directions
from placefield_tools.sources.degrees import to_local_metres

DefaultStamp = Callable[[int], int]
"""Gives the stamp, in ns, of the frame of a number, where no other is known."""

Position = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Listed:
    """A frame whose image has not been read yet; ``file`` is relative to the folder."""

    file: str
    stamp_ns: int
    pose: Pose | None = None
    odometry_m: float | None = None


@dataclass(frozen=True, slots=True)
class Listing:
    """The frames of a folder in their order.

    Attributes:
        frames: in that order.
        origin: of their poses, if that is known.
        stamped: whether their stamps are their own.
    """

    frames: list[Listed]
    origin: Origin | None = None
    stamped: bool = True


def with_positions(
    frames: Sequence[Listed],
    positions: Sequence[Position | None],
    yaws: Sequence[float] | None = None,
    *,
    in_degrees: bool,
) -> Listing:
    """Give frames the poses at their positions; those of None stay without.

    Where all are known, the metres along them are the odometry of frames that have no other.

    Args:
        frames: K frames.
        positions: of each: x and y, or latitude and longitude, where known.
        yaws: of each, in radians; None: where the vehicle drives, for it looks there.
        in_degrees: the positions are latitudes and longitudes; the first becomes the origin.

    Raises:
        ValueError: a position is nowhere on earth.
    """
    known = [number for number, position in enumerate(positions) if position is not None]
    if not known:
        return Listing(list(frames))
    places = np.array([position for position in positions if position is not None])
    origin = None
    if in_degrees:
        origin, places = to_local_metres(places)
    turned = directions(places) if yaws is None else np.array(yaws)[known]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    metres = np.concatenate([[0.0], np.cumsum(steps)])
    located = list(frames)
    for number, (x, y), yaw in zip(known, places.tolist(), turned.tolist(), strict=True):
        frame = frames[number]
        travelled_m = frame.odometry_m
        if len(known) == len(frames) and travelled_m is None:
            travelled_m = float(metres[number])
        located[number] = replace(frame, pose=Pose(x, y, yaw), odometry_m=travelled_m)
    return Listing(located, origin)
