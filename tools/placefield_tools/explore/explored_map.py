"""The map of an explored drive."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import MapError
from placefield.features.calibration import Calibration, View
from placefield.features.extract import feature_of
from placefield.features.local_descriptors import LocalDescriptors
from placefield.features.raw_stage import raw_fingerprint
from placefield.features.rectification import view_of
from placefield.maps.drive_file import DriveFrame, read_drive
from placefield.maps.map import Map
from placefield.maps.traverse import DescribedFrame, Traverse, traverse_of
from placefield_tools.build.map_from_sources import built_of
from placefield_tools.build.used_part import UsedPart

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class AskedMap:
    """The map that an exploration is to make.

    Attributes:
        path: of the map.
        config: of the services and of the map.
        camera: whose view the frames are rectified to; None: they are used as they are.
    """

    path: Path
    config: Config
    camera: Calibration | None = None

    @property
    def feature(self) -> str:
        """The fingerprint of the feature of its drive.

        Raises:
            ConfigError: see ``raw_fingerprint``.
        """
        return raw_fingerprint(self.config.features.kind, self.camera)

    @property
    def view(self) -> View | None:
        """The view that the frames are rectified to.

        Raises:
            ConfigError: the camera has none.
        """
        return None if self.camera is None else view_of(self.camera)


def build_explored(drive: Path, asked: AskedMap) -> Map:
    """Build a map of the frames of a drive that became places, showing progress.

    Args:
        drive: its file.
        asked: the map.

    Raises:
        MapError: the file is of no drive, or the drive is too short for a map.
        ConfigError: the feature's network cannot be read.
        OSError: the file cannot be read.
    """
    frames = {frame.number: frame for frame in read_drive(drive)}
    places = places_of([*frames.values()])
    if not places:
        raise MapError(f"{drive}: the views of {len(frames)} frames change too little for a map")
    name = f"{asked.path.stem}, explored"
    traverse = _traverse(name, [frames[number] for number in places])
    parts = feature_of(asked.config.features.kind).parts
    return UsedPart(asked.view).in_map(built_of([traverse], asked.config, parts))


def places_of(frames: Sequence[DriveFrame]) -> list[int]:
    """Return the numbers of the frames that an explorer makes places of: the vehicle moved."""
    descriptors, places, last = LocalDescriptors(), [], -1.0
    for frame in frames:
        for described in descriptors.update(frame.raw):
            if described.travelled != last:
                places.append(frames[described.frame].number)
                last = described.travelled
    return places


def _traverse(name: str, frames: Sequence[DriveFrame]) -> Traverse:
    readings = [frame.odometry_m for frame in frames]
    metres = [reading for reading in readings if reading is not None]
    if len(metres) == len(frames) and (np.diff(metres) < 0).any():
        log.warning("%s: the odometer was reset during the drive; its metres are left out", name)
        readings = [None] * len(frames)
    described = (
        DescribedFrame(_raw_of(frame), frame.stamp_ns, None, metre, frame.thumbnail)
        for frame, metre in zip(frames, readings, strict=True)
    )
    return traverse_of(name, described)


def _raw_of(frame: DriveFrame) -> NDArray[np.float32]:
    assert frame.raw is not None  # a place was observed
    return frame.raw
