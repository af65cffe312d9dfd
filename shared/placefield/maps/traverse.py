"""Frames to what a map is built from: raw features, stamps, poses, thumbnails."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError, MapError, SourceError
from placefield.features.extract import Feature
from placefield.features.frames import Frame, Pose
from placefield.features.images import decode

_THUMBNAIL_WIDTH = 160  # pixels
_THUMBNAIL_QUALITY = 80


@dataclass(frozen=True)
class DescribedFrame:
    """What a map keeps of one frame."""

    raw: NDArray[np.float32]
    stamp_ns: int
    pose: Pose | None
    thumbnail: bytes


@dataclass(frozen=True)
class Traverse:
    """One reference traverse of K frames.

    Attributes:
        name: for a person.
        raw: (K, D) float32, raw features.
        stamps: (K,) int64, nanoseconds.
        poses: (K, 3) float64, x and y in metres and yaw in radians; (0, 3) if a frame has none.
        thumbnails: K JPEG images.
    """

    name: str
    raw: NDArray[np.float32]
    stamps: NDArray[np.int64]
    poses: NDArray[np.float64]
    thumbnails: tuple[bytes, ...]


def describe_frame(frame: Frame, feature: Feature) -> DescribedFrame:
    """Describe a reference frame.

    Raises:
        SourceError: it cannot be read. A map is built once and used for long: one broken frame
            would shift every place behind it, so that the build ends here.
    """
    pixels = _pixels(frame)
    raw = feature.describe(pixels)
    return DescribedFrame(raw, frame.stamp_ns, frame.pose, _thumbnail(pixels))


def traverse_of(name: str, described: Iterable[DescribedFrame]) -> Traverse:
    """Put the described frames of one traverse together.

    Raises:
        MapError: there is none.
    """
    frames = list(described)
    if not frames:
        raise MapError(f"{name}: no frames to build a map from")
    poses = [(f.pose.x, f.pose.y, f.pose.yaw) for f in frames if f.pose is not None]
    return Traverse(
        name,
        np.stack([frame.raw for frame in frames]),
        np.array([frame.stamp_ns for frame in frames], np.int64),
        np.array(poses if len(poses) == len(frames) else [], np.float64).reshape(-1, 3),
        tuple(frame.thumbnail for frame in frames),
    )


def _pixels(frame: Frame) -> NDArray[np.uint8]:
    if not isinstance(frame.image, bytes):
        return frame.image
    try:
        return decode(frame.image)
    except FrameError as error:
        raise SourceError(
            f"{frame.name}: {error}; a reference needs every frame: extract it again or remove it"
        ) from None


def _thumbnail(pixels: NDArray[np.uint8]) -> bytes:
    height, width = pixels.shape[:2]
    if width > _THUMBNAIL_WIDTH:
        size = (_THUMBNAIL_WIDTH, max(1, round(height * _THUMBNAIL_WIDTH / width)))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, _THUMBNAIL_QUALITY]
    return cv2.imencode(".jpg", pixels, quality)[1].tobytes()
