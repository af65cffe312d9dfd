"""Frames to what a map is built from: raw features, stamps, poses, thumbnails."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError, MapError
from placefield.features.extract import Feature
from placefield.features.frames import Frame, Pose
from placefield.features.images import small_jpeg
from placefield.maps.trajectory import MAX_GAP_NS, Trajectory, travelled

log = logging.getLogger(__name__)

ROUTE = "route"
"""The frame of poses that are in metres of the user's own."""

_THUMBNAIL = 160  # pixels of a side, at most


@dataclass(frozen=True)
class DescribedFrame:
    """What a map keeps of one frame."""

    raw: NDArray[np.float32]
    stamp_ns: int
    pose: Pose | None
    odometry_m: float | None
    thumbnail: bytes


@dataclass(frozen=True)
class Traverse:
    """One reference traverse of K frames.

    Attributes:
        name: for a person.
        raw: (K, D) float32, raw features.
        stamps: (K,) int64, nanoseconds.
        poses: (K, 3) float64, x and y in metres and yaw in radians; (0, 3) if no frame has one.
        travelled: (K,) float64, metres from the first frame to each, not descending; (0,) if nobody
            knows.
        thumbnails: K JPEG images.
        pose_frame: what the poses are measured in, as a map's.
    """

    name: str
    raw: NDArray[np.float32]
    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    travelled: NDArray[np.float64]
    thumbnails: tuple[bytes, ...]
    pose_frame: str = ROUTE


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
    name: str, described: Iterable[DescribedFrame], pose_frame: str = ROUTE
) -> Traverse:
    """Put the described frames of one traverse together.

    A frame without a pose lies by its stamp between the poses before and after it, if these are
    close (see ``Trajectory.at``), or at the first or the last, if it is at most half the usual step
    outside; how many do is logged.

    The metres travelled are the odometry's where all frames have a reading, else those along the
    poses.

    Raises:
        MapError: there is no frame; only some frames have poses, and the others lie too far off, or
            the stamps do not ascend; the odometry goes back, or is not finite.
    """
    frames = list(described)
    if not frames:
        raise MapError(f"{name}: no frames to build a map from")
    stamps = np.array([frame.stamp_ns for frame in frames], np.int64)
    poses = _poses(name, stamps, [frame.pose for frame in frames])
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
    name: str, stamps: NDArray[np.int64], given: Sequence[Pose | None]
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
    if has_pose.all():
        return poses
    if (np.diff(stamps) <= 0).any():
        raise MapError(
            f"{name}: {len(given) - len(rows)} of {len(given)} frames have no pose, and the stamps "
            "do not ascend, which would tell where they lie: give poses to all frames, or to none"
        )
    poses[~has_pose] = Trajectory.of(stamps[has_pose], poses[has_pose]).at(stamps[~has_pose])[:, :3]
    unknown = np.flatnonzero(np.isnan(poses[:, 0]))
    if len(unknown):
        raise MapError(
            f"{name}: {len(unknown)} of {len(given)} frames have no pose, nor the way from one to "
            f"the next within {MAX_GAP_NS / 1e9:g} s (the first is number {unknown[0]}): "
            "give poses to all frames, or to none"
        )
    log.warning("%s: %d of %d poses are between others", name, len(given) - len(rows), len(given))
    return poses


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
