"""The frames of a folder or of a file of descriptors, before they are read."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from placefield.errors import SourceError
from placefield.features.frames import Pose
from placefield.maps.geography import Origin
from placefield.maps.trajectory import directions
from placefield_tools.sources.degrees import to_local_metres
from placefield_tools.sources.source import Span

NOMINAL_RATE = 10
"""Nominal frames per second of frames without stamps."""

DefaultStamp = Callable[[int], int]
"""Gives the nominal stamp of a frame, nanoseconds, by the frame's number."""

Position = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Listed:
    """A frame that has not been read yet; ``file`` is relative to the folder, or empty."""

    file: str
    stamp_ns: int
    pose: Pose | None = None
    odometry_m: float | None = None


@dataclass(frozen=True, slots=True)
class Listing:
    """The frames of a source.

    Attributes:
        frames: in the order of the drive.
        origin: georeference of their poses, if known.
        stamped: whether the stamps are measured, and not nominal.
    """

    frames: list[Listed]
    origin: Origin | None = None
    stamped: bool = True

    @property
    def span(self) -> Span | None:
        """From when to when the frames were taken; None if the stamps are nominal."""
        if all(frame.stamp_ns == nominal_stamp_ns(at) for at, frame in enumerate(self.frames)):
            return None
        return Span(self.frames[0].stamp_ns, self.frames[-1].stamp_ns)

    def chosen(self, start: int, stride: int, path: Path) -> range:
        """Return the numbers of the frames from ``start`` on, every ``stride``-th.

        Raises:
            SourceError: there is none; the error names the source at ``path``.
        """
        chosen = range(start, len(self.frames), stride)
        if not chosen:
            raise SourceError(f"--start {start}: {path} holds only {len(self.frames)} frames")
        return chosen


def nominal_stamp_ns(index: int) -> int:
    """Return the stamp of a frame without one, at ``NOMINAL_RATE``."""
    return index * 1_000_000_000 // NOMINAL_RATE


def with_positions(
    frames: Sequence[Listed],
    positions: Sequence[Position | None],
    yaws: Sequence[float] | None = None,
    *,
    in_degrees: bool,
) -> Listing:
    """Return the listing of frames with poses at their positions.

    If all positions are known, the metres along them are the odometry of frames without one.

    Args:
        frames: K frames.
        positions: K positions, x and y or latitude and longitude; None where unknown.
        yaws: K yaws in radians; None: the direction of travel is used.
        in_degrees: whether the positions are latitudes and longitudes; the first is the origin.

    Raises:
        ValueError: a latitude is beyond ±90 degrees, or a longitude beyond ±180.
    """
    known = [number for number, position in enumerate(positions) if position is not None]
    if not known:
        return Listing(list(frames))
    places = np.array([position for position in positions if position is not None])
    origin = None
    if in_degrees:
        origin, places = to_local_metres(places)
    headings = directions(places) if yaws is None else np.array(yaws)[known]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    metres = np.concatenate([[0.0], np.cumsum(steps)])
    posed = list(frames)
    for number, (x, y), yaw in zip(known, places.tolist(), headings.tolist(), strict=True):
        frame = frames[number]
        travelled_m = frame.odometry_m
        if len(known) == len(frames) and travelled_m is None:
            travelled_m = float(metres[number])
        posed[number] = replace(frame, pose=Pose(x, y, yaw), odometry_m=travelled_m)
    return Listing(posed, origin)
