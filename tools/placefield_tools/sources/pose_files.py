"""Files of poses beside a source of frames: a TUM trajectory, or KITTI's ground truth.

TUM: a line is ``stamp tx ty tz qx qy qz qw``, seconds, metres and a quaternion; x and y are the
ground and the yaw is the vehicle's forward axis x (REP 103). KITTI: a line is a 3 × 4 matrix, row
by row, of the left camera in the first frame's, which looks along z and has x on its right; each
frame has its line. A line that starts with # is a remark, and commas will do for spaces.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.errors import SourceError
from placefield.maps.trajectory import Trajectory
from placefield_tools.sources.seconds import nanoseconds

_TUM, _KITTI = 8, 12

_NUMBERED_NS = 1_000_000_000


@dataclass(frozen=True)
class PoseFile:
    """The poses of a file, by the time, or by the number of the frame where ``numbered``."""

    trajectory: Trajectory
    numbered: bool

    def key(self, index: int, stamp_ns: int) -> int:
        """Return where in the trajectory a frame is."""
        return index * _NUMBERED_NS if self.numbered else stamp_ns


def read_pose_file(path: Path) -> PoseFile:
    """Read the poses of a file.

    Raises:
        SourceError: it cannot be read, or a line, which is named, is neither of both formats.
    """
    lines = _lines(path)
    columns = len(lines[0][1])
    if columns not in (_TUM, _KITTI):
        raise SourceError(
            f"{path}, line {lines[0][0]}: {columns} numbers; a line has {_TUM} (TUM: "
            f"stamp tx ty tz qx qy qz qw) or {_KITTI} (KITTI)"
        )
    table = np.empty((len(lines), columns))
    stamps = np.arange(len(lines), dtype=np.int64) * _NUMBERED_NS
    for at, (line, cells) in enumerate(lines):
        try:
            table[at] = _numbers(cells, columns)
            if columns == _TUM:
                stamps[at] = nanoseconds(cells[0])
        except ValueError as error:
            raise SourceError(f"{path}, line {line}: {error}") from error
    poses = _tum_poses(table) if columns == _TUM else _kitti_poses(table)
    return PoseFile(Trajectory.of(stamps, poses), columns == _KITTI)


def quaternion_yaws(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the yaw, (N,) radians, of the axis x that quaternions (N, 4) x y z w turn."""
    x, y, z, w = quaternions.T
    yaws: NDArray[np.float64] = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return yaws


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return (line number, cells) of each line that is not empty and no remark."""
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
        raise ValueError(f"{len(cells)} numbers, the first line {count}")
    numbers = [float(cell) for cell in cells]
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a number is not finite")
    return numbers


def _tum_poses(table: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([table[:, 1:3], quaternion_yaws(table[:, 4:8])])


def _kitti_poses(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lay the camera's ground, z forward and x on the right, as x forward and y on the left."""
    matrices = table.reshape(-1, 3, 4)
    right, _, forward = matrices[:, :, 3].T
    looks_right, looks_forward = matrices[:, 0, 2], matrices[:, 2, 2]
    return np.column_stack([forward, -right, np.arctan2(-looks_right, looks_forward)])
