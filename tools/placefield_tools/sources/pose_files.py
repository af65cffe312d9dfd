"""Files of poses beside a source of frames: a TUM trajectory, or KITTI's ground truth.

TUM: a line is ``stamp tx ty tz qx qy qz qw``, in seconds and metres, with a quaternion. By default,
the axes are the vehicle's, with x forward (REP 103); they may also be a camera's, with z forward
and x right. KITTI: a line is a 3 × 4 matrix, row by row: the pose of the left camera in the axes of
its first frame, by default with z forward. Each frame has one line. A line that starts with # is a
comment, and commas may replace spaces.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from placefield.errors import SourceError
from placefield.maps.trajectory import PoseAxes, Trajectory
from placefield_tools.sources.pose_axes import forwards_of, ground_poses
from placefield_tools.sources.seconds import nanoseconds

_TUM, _KITTI = 8, 12

_OTHER_AXES: dict[PoseAxes, str] = {
    "x-forward": "give --pose-axes z-forward",
    "z-forward": "give --pose-axes x-forward",
}

_NUMBERED_NS = 1_000_000_000

LARGEST = 1e12
"""Every valid number of metres or seconds, and every part of a rotation, is smaller."""


@dataclass(frozen=True)
class PoseFile:
    """The poses of a file, by time, or if ``numbered`` by the number of the frame.

    Attributes:
        trajectory: of the poses.
        numbered: whether line i belongs to frame i.
        poses: (N, 3) float64, x, y and yaw, a row per line.
    """

    trajectory: Trajectory
    numbered: bool
    poses: NDArray[np.float64]

    def key(self, index: int, stamp_ns: int) -> int:
        """Return the instant of a frame in the trajectory, nanoseconds."""
        return index * _NUMBERED_NS if self.numbered else stamp_ns

    def by_number(self) -> Self:
        """Return the same poses by the number of the frame."""
        return type(self)(_numbered(self.poses), True, self.poses)


def read_pose_file(path: Path, axes: PoseAxes | None = None) -> PoseFile:
    """Read a file of poses; the default axes are the vehicle's for TUM and the camera's for KITTI.

    Raises:
        SourceError: the file cannot be read, or a line has neither format; the line is named.
    """
    lines = _lines(path)
    columns = len(lines[0][1])
    if columns not in (_TUM, _KITTI):
        raise SourceError(
            f"{path}, line {lines[0][0]}: {columns} numbers; a line has {_TUM} (TUM: "
            f"stamp tx ty tz qx qy qz qw) or {_KITTI} (KITTI)"
        )
    table = np.empty((len(lines), columns))
    stamps = np.zeros(len(lines), np.int64)
    for at, (line, cells) in enumerate(lines):
        try:
            table[at] = _numbers(cells, columns)
            if columns == _TUM:
                stamps[at] = nanoseconds(cells[0])
        except ValueError as error:
            raise SourceError(f"{path}, line {line}: {error}") from error
    if columns == _KITTI:
        poses = _kitti_poses(path, table, axes or "z-forward")
        return PoseFile(_numbered(poses), True, poses)
    poses = _tum_poses(path, table, axes or "x-forward")
    return PoseFile(Trajectory.of(stamps, poses), False, poses)


def _numbered(poses: NDArray[np.float64]) -> Trajectory:
    return Trajectory.of(np.arange(len(poses), dtype=np.int64) * _NUMBERED_NS, poses)


def _tum_poses(path: Path, table: NDArray[np.float64], axes: PoseAxes) -> NDArray[np.float64]:
    forwards = forwards_of(table[:, 4:8], axes)
    return ground_poses(str(path), table[:, 1:4], forwards, axes, _OTHER_AXES[axes])


def _kitti_poses(path: Path, table: NDArray[np.float64], axes: PoseAxes) -> NDArray[np.float64]:
    matrices = table.reshape(-1, 3, 4)
    forwards = matrices[:, :, 2 if axes == "z-forward" else 0]
    return ground_poses(str(path), matrices[:, :, 3], forwards, axes, _OTHER_AXES[axes])


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return (line number, cells) of each line that is neither empty nor a comment."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f"{path}: cannot be read as a file of poses ({error})") from error
    lines = [
        (number, line.replace(",", " ").split())
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise SourceError(f"{path}: holds no poses")
    return lines


def _numbers(cells: list[str], count: int) -> list[float]:
    if len(cells) != count:
        raise ValueError(f"has {len(cells)} numbers, and the first line has {count}")
    numbers = [float(cell) for cell in cells]
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a number is not finite")
    if max(map(abs, numbers)) >= LARGEST:
        raise ValueError(f"the number {max(numbers, key=abs):g} is too large")
    return numbers
