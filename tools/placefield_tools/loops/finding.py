"""Finding the loops of one drive, from its frames."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import FrameError, SourceError
from placefield.features.extract import feature_of
from placefield.features.frames import Frame, Pose
from placefield.features.raw_stage import check_one_part
from placefield.features.rectification import image_of, view_of
from placefield.matching.exploring import Answer, Explorer
from placefield.verification.extracting import extract
from placefield.verification.local_features import LocalFeatures
from placefield.verification.relative_pose import Camera, camera_of
from placefield_tools.common.parallel import map_in_order
from placefield_tools.common.progress import tracked
from placefield_tools.sources import Source
from placefield_tools.sources.frame_content import check_images, with_feature_of

log = logging.getLogger(__name__)

_LOCAL_FEATURES = 600  # of a frame, at most


class DriveFrame(NamedTuple):
    """A frame of a drive, without its image.

    Attributes:
        number: its index in the source.
        stamp_ns: when it was taken, nanoseconds.
        pose: None if unknown.
        odometry_m: metres travelled since any fixed start, None if unknown.
        local_features: of the image, for its relative poses; None if they are not asked for.
    """

    number: int
    stamp_ns: int
    pose: Pose | None
    odometry_m: float | None
    local_features: LocalFeatures | None = None


@dataclass(frozen=True)
class DriveLoops:
    """The Q frames of a drive, and for each of them the earlier place that it shows.

    Attributes:
        frames: Q frames.
        causal: Q answers, each from the frames up to it. Their places are positions in ``frames``.
        smoothed: Q answers, each also from some later frames.
        tolerance: places within which an answer is right.
        camera: that took the frames; None if it is not known, so that loops have no relative pose.
    """

    frames: Sequence[DriveFrame]
    causal: Sequence[Answer]
    smoothed: Sequence[Answer]
    tolerance: int
    camera: Camera | None = None

    def __repr__(self) -> str:
        return f"DriveLoops({len(self.frames)} frames, {self.count()} in loops)"

    def count(self) -> int:
        """Return how many frames are known to show an earlier place, once smoothed."""
        return sum(answer.known for answer in self.smoothed)


def find_loops(source: Source, name: str, config: Config) -> DriveLoops:
    """Match each frame of a drive with the earlier ones, showing progress.

    An unreadable frame is a missing observation; the number of them is logged.

    Args:
        source: of the frames; it is closed at the end.
        name: of the drive, used in messages.
        config: its kind of feature, tolerance, precision, lag and focal length count; the focal
            length only if the camera is not known.

    Raises:
        SourceError: the source fails, is a live camera, or none of its frames can be read.
        ConfigError: the feature has several parts or cannot be computed, the camera has no view
            (see ``view_of``), or the focal length is given, and the camera is known or the frames
            are descriptors.
    """
    if source.live:
        raise SourceError(f"{name}: loops are not found with a live camera; record a drive first")
    config = with_feature_of(source, name, config)
    check_one_part(config.features.kind)
    view = None if source.calibration is None else view_of(source.calibration)
    feature = replace(feature_of(config.features.kind, config.inference), view=view)
    focal = config.verification.focal
    if focal is not None:
        check_images(source, "setting verification.focal")
    camera = camera_of(view, focal)
    faults: list[FrameError] = []

    def describe(frame: Frame) -> tuple[DriveFrame, NDArray[np.float32] | None]:
        kept = DriveFrame(frame.index, frame.stamp_ns, frame.pose, frame.odometry_m)
        try:
            raw = feature.of_frame(frame)
            if camera is not None and frame.descriptor is None:
                image = image_of(frame, view)
                kept = kept._replace(local_features=extract(image, _LOCAL_FEATURES))
            return kept, raw
        except FrameError as error:
            faults.append(FrameError(f"{frame.name}: {error}"))
            return kept, None

    explorer = Explorer(config.matching)
    frames: list[DriveFrame] = []
    causal: list[Answer] = []
    smoothed: list[Answer] = []
    with source, tracked(source, f"finding loops in {name}", source.count) as read:
        for kept, raw in map_in_order(describe, read):
            frames.append(kept)
            causal.append(explorer.update(raw))
            smoothed += [each.answer for each in explorer.smoothed()]
    smoothed += [each.answer for each in explorer.finish()]
    if len(faults) == len(frames):
        why = f" ({faults[0]})" if faults else ""
        raise SourceError(f"{name}: no frame can be read{why}")
    if faults:
        log.warning("%s: %d of %d frames cannot be read", name, len(faults), len(frames))
    return DriveLoops(frames, causal, smoothed, config.matching.tolerance, camera)
