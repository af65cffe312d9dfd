"""Frames to what a map is built from: raw features, stamps, poses, thumbnails."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError, MapError
from placefield.features.extract import Feature
from placefield.features.frames import Frame, Pose
from placefield.features.images import small_jpeg
from placefield.maps.jumps import told_jumps
from placefield.maps.manifest import AlignedBy
from placefield.maps.trajectory import Trajectory, travelled

log = logging.getLogger(__name__)

ROUTE = "route"
"""The frame of poses that are in metres of the user's own."""

NO_PLACE = -1
"""Stands for the place of a frame that shows none."""

_THUMBNAIL = 160  # pixels of a side, at most


@dataclass(frozen=True)
class DescribedFrame:
    """What a map keeps of one frame."""

    raw: NDArray[np.float32]
    stamp_ns: int
    pose: Pose | None
    odometry_m: float | None
    thumbnail: bytes


class Alignment(NamedTuple):
    """Which place each of the M frames of a drive shows.

    Attributes:
        places: (M,) int32, -1 where it is not known, or a frame shows none.
        probability: (M,) float32, posterior that a frame was taken within a few places of the
            likeliest one, whether that is known or not.
        by: what they were aligned.
    """

    places: NDArray[np.int32]
    probability: NDArray[np.float32]
    by: AlignedBy

    @property
    def aligned(self) -> int:
        """How many frames show a place; the others are left out."""
        return int(np.count_nonzero(self.places != NO_PLACE))

    def shown(self) -> NDArray[np.intp]:
        """Return the frames that show a place, ascending; of several of one place, the likeliest.

        So a stop, or a slow drive, weighs no more than the reference does.
        """
        order = np.lexsort((-self.probability, self.places))
        order = order[self.places[order] != NO_PLACE]
        first = np.unique(self.places[order], return_index=True)[1]
        return np.sort(order[first])


@dataclass(frozen=True)
class Traverse:
    """One reference traverse of K frames.

    Attributes:
        name: for a person.
        raw: (K, D) float32, raw features.
        stamps: (K,) int64, nanoseconds.
        poses: (K, 3) float64, x and y in metres and yaw in radians, NaN where nobody knows; (0, 3)
            if no frame has one.
        travelled: (K,) float64, metres from the first frame to each, not descending; (0,) if nobody
            knows.
        thumbnails: K JPEG images.
        pose_frame: what the poses are measured in, as a map's.
        alignment: which places of the first traverse its frames show; None: frame i, place i.
    """

    name: str
    raw: NDArray[np.float32]
    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    travelled: NDArray[np.float64]
    thumbnails: tuple[bytes, ...]
    pose_frame: str = ROUTE
    alignment: Alignment | None = None

    def __repr__(self) -> str:
        frames, dimensions = self.raw.shape
        return f"Traverse({self.name!r}, {frames} frames, features of {dimensions} dimensions)"


def describe_frame(frame: Frame, feature: Feature) -> DescribedFrame:
    """Describe a reference frame.

    Raises:
        FrameError: it cannot be read; the error begins with its name.
    """
    try:
        pixels = frame.pixels()
        raw = feature.describe(pixels)
    except FrameError as error:
        raise FrameError(f"{frame.name}: {error}") from None
    thumbnail = small_jpeg(pixels, _THUMBNAIL)
    return DescribedFrame(raw, frame.stamp_ns, frame.pose, frame.odometry_m, thumbnail)


def traverse_of(
    name: str,
    described: Iterable[DescribedFrame],
    pose_frame: str = ROUTE,
    *,
    stamped: bool = True,
) -> Traverse:
    """Put the described frames of one traverse together.

    A frame without a pose lies by its stamp between the poses before and after it, if these are
    close (see ``Trajectory.at``), or at the first or the last, if it is at most half the usual step
    outside. Where that is not so, the stamps do not ascend, or are not ``stamped``, the frames'
    own, nobody knows its pose. How many are so is logged, and where poses jump.

    The metres travelled are the odometry's where all frames have a reading, else those along the
    poses.

    Raises:
        MapError: there is no frame; a pose is not finite; the odometry goes back, or is not finite.
    """
    frames = list(described)
    if not frames:
        raise MapError(f"{name}: no frames to build a map from")
    stamps = np.array([frame.stamp_ns for frame in frames], np.int64)
    poses = _poses(name, stamps if stamped else None, [frame.pose for frame in frames])
    return Traverse(
        name,
        np.stack([frame.raw for frame in frames]),
        stamps,
        poses,
        _travelled(name, poses, [frame.odometry_m for frame in frames]),
        tuple(frame.thumbnail for frame in frames),
        pose_frame,
    )


def _poses(
    name: str, stamps: NDArray[np.int64] | None, given: Sequence[Pose | None]
) -> NDArray[np.float64]:
    has_pose = np.array([pose is not None for pose in given])
    rows = [(pose.x, pose.y, pose.yaw) for pose in given if pose is not None]
    if not rows:
        return np.empty((0, 3))
    poses = np.full((len(given), 3), np.nan)
    poses[has_pose] = rows
    astray = np.flatnonzero(has_pose & ~np.isfinite(poses).all(axis=1))
    if len(astray):
        raise MapError(f"{name}: the pose of frame {astray[0]} is not finite")
    if stamps is not None and (np.diff(stamps) <= 0).any():
        stamps = None
    if not has_pose.all():
        _fill(name, stamps, poses, has_pose)
    if jumps := told_jumps(poses, stamps):
        log.warning("%s: %s", name, jumps)
    return poses


def _fill(
    name: str,
    stamps: NDArray[np.int64] | None,
    poses: NDArray[np.float64],
    has_pose: NDArray[np.bool_],
) -> None:
    """Put poses between those that are given, where their stamps tell, and log how many."""
    if stamps is not None:
        way = Trajectory.of(stamps[has_pose], poses[has_pose])
        poses[~has_pose] = way.at(stamps[~has_pose])[:, :3]
    unknown = int(np.isnan(poses[:, 0]).sum())
    if between := int((~has_pose).sum()) - unknown:
        log.warning("%s: %d of %d poses are between others", name, between, len(poses))
    if unknown:
        log.warning("%s: %d of %d frames have no pose", name, unknown, len(poses))


def _travelled(
    name: str, poses: NDArray[np.float64], given: Sequence[float | None]
) -> NDArray[np.float64]:
    metres = np.array([reading for reading in given if reading is not None], np.float64)
    if len(metres) < len(given):
        metres = travelled(poses) if len(poses) else np.empty(0)
    wrong = np.flatnonzero(~(np.isfinite(metres) & (np.diff(metres, prepend=-np.inf) >= 0)))
    if len(wrong):
        raise MapError(
            f"{name}: the odometry of frame {wrong[0]} is less than the one before, or not finite: "
            "mend it, or leave it out"
        )
    return np.asarray(metres - metres[:1])
