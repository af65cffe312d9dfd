"""Reference traverses, which maps are built from: raw features, stamps, poses, thumbnails."""

import hashlib
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
from placefield.features.rectification import image_of
from placefield.maps.manifest import AlignedBy
from placefield.maps.plausible_steps import implausible_steps
from placefield.maps.route_graph import RouteGraph
from placefield.maps.trajectory import Trajectory, travelled
from placefield.verification.extractor import Extractor
from placefield.verification.local_features import LocalFeatures

log = logging.getLogger(__name__)

ROUTE = "route"
"""Name of the coordinate frame of poses that are not georeferenced."""

NO_PLACE = -1
"""The place of a frame that shows no place."""

THUMBNAIL = 160
"""Pixels of a thumbnail's side, at most."""


@dataclass(frozen=True)
class DescribedFrame:
    """A frame as a map keeps it: raw feature, stamp, pose, odometry, thumbnail, local features.

    The thumbnail is empty if the frame is a given descriptor.
    """

    raw: NDArray[np.float32]
    stamp_ns: int
    pose: Pose | None
    odometry_m: float | None
    thumbnail: bytes
    local_features: LocalFeatures | None = None


class Alignment(NamedTuple):
    """The place that each of the M frames of a drive shows.

    Attributes:
        places: (M,) int32, -1 if a frame shows no place, or if its place is not known.
        probability: (M,) float32, the posterior probability that a frame was taken within a few
            places of the likeliest one, also where this is too low for a known place.
        by: the method of the alignment.
    """

    places: NDArray[np.int32]
    probability: NDArray[np.float32]
    by: AlignedBy

    @property
    def aligned(self) -> int:
        """The number of frames that show a place; the others are left out."""
        return int(np.count_nonzero(self.places != NO_PLACE))

    def shown(self) -> NDArray[np.intp]:
        """Return the numbers of the frames to learn from, ascending: one for each place shown.

        It is the likeliest of the place's frames. A stop or a slow drive thus has no more weight
        than one frame per place.
        """
        order = np.lexsort((-self.probability, self.places))
        order = order[self.places[order] != NO_PLACE]
        first = np.unique(self.places[order], return_index=True)[1]
        return np.sort(order[first])


@dataclass(frozen=True)
class Traverse:
    """One reference traverse of K frames.

    Attributes:
        name: used in messages.
        raw: (K, D) float32, raw features.
        stamps: (K,) int64, nanoseconds.
        poses: (K, 3) float64, x and y in metres and yaw in radians, NaN where unknown; (0, 3) if no
            frame has a pose.
        travelled: (K,) float64, metres from the first frame to each, never descending; (0,) if
            unknown.
        thumbnails: K JPEG images; K times nothing if the frames are given descriptors.
        pose_frame: name of the poses' coordinate frame, as in a map.
        local_features: of the K frames; empty if there are none.
        local_network: (bytes,) uint8, the file of the network that gave them; None: SIFT, or none.
        alignment: the place of the first traverse that each frame shows; None: frame i
            shows place i.
        graph: the routes that the frames are of, one after the other, and links between frames that
            are given; None: one route.
    """

    name: str
    raw: NDArray[np.float32]
    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    travelled: NDArray[np.float64]
    thumbnails: tuple[bytes, ...]
    pose_frame: str = ROUTE
    local_features: tuple[LocalFeatures, ...] = ()
    local_network: NDArray[np.uint8] | None = None
    alignment: Alignment | None = None
    graph: RouteGraph | None = None

    @property
    def routes(self) -> RouteGraph:
        """The routes of the frames; without a graph there is one, of the traverse's name."""
        return RouteGraph.line(self.name) if self.graph is None else self.graph

    def __repr__(self) -> str:
        frames, dimensions = self.raw.shape
        return f"Traverse({self.name!r}, {frames} frames, features of {dimensions} dimensions)"


def content_of(raw: Iterable[NDArray[np.float32]]) -> str:
    """Return the SHA-256 of raw features (D,) of frames, as hexadecimal digits.

    Two drives with the same checksum are the same frames.
    """
    checksum = hashlib.sha256()
    for row in raw:
        checksum.update(np.ascontiguousarray(row, "<f4").data)
    return checksum.hexdigest()


def describe_frame(
    frame: Frame, feature: Feature, extractor: Extractor | None = None
) -> DescribedFrame:
    """Describe a reference frame; without an extractor it has no local features.

    Raises:
        FrameError: the frame cannot be read; the error begins with its name.
    """
    try:
        raw, image = feature.observe(frame)
        local = None
        if extractor is not None and image is not None:
            whole = image_of(frame, feature.view)
            local = extractor.extract(feature.used(whole))
    except FrameError as error:
        raise FrameError(f"{frame.name}: {error}") from None
    thumbnail = b"" if image is None else small_jpeg(image, THUMBNAIL)
    return DescribedFrame(raw, frame.stamp_ns, frame.pose, frame.odometry_m, thumbnail, local)


def traverse_of(
    name: str,
    described: Iterable[DescribedFrame],
    pose_frame: str = ROUTE,
    *,
    stamped: bool = True,
) -> Traverse:
    """Assemble a traverse from its described frames.

    The pose of a frame without one is interpolated by its stamp, see ``Trajectory.at``. It stays
    unknown if the neighbouring poses are too far apart in time, if the stamps do not ascend, or if
    the stamps are nominal (``stamped`` is false). Interpolated poses, unknown poses and implausible
    steps are logged.

    The metres travelled are those of the odometry if all frames have a reading, and otherwise those
    along the poses.

    Raises:
        MapError: there is no frame, a pose is not finite, or the odometry descends or is not
            finite.
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
        tuple(frame.local_features for frame in frames if frame.local_features is not None),
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
    wrong = np.flatnonzero(has_pose & ~np.isfinite(poses).all(axis=1))
    if len(wrong):
        raise MapError(f"{name}: the pose of frame {wrong[0]} is not finite")
    if stamps is not None and (np.diff(stamps) <= 0).any():
        stamps = None
    if not has_pose.all():
        _fill(name, stamps, poses, has_pose)
    if implausible := implausible_steps(poses, stamps):
        log.warning("%s: %s", name, implausible)
    return poses


def _fill(
    name: str,
    stamps: NDArray[np.int64] | None,
    poses: NDArray[np.float64],
    has_pose: NDArray[np.bool_],
) -> None:
    """Interpolate missing poses by their stamps, and log how many were and how many were not."""
    if stamps is not None:
        trajectory = Trajectory.of(stamps[has_pose], poses[has_pose])
        poses[~has_pose] = trajectory.at(stamps[~has_pose])[:, :3]
    unknown = int(np.isnan(poses[:, 0]).sum())
    if between := int((~has_pose).sum()) - unknown:
        log.warning("%s: %d of %d poses are interpolated", name, between, len(poses))
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
            "correct it, or leave it out"
        )
    return np.asarray(metres - metres[:1])
