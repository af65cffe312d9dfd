"""Files of poses beside a source of frames: a TUM trajectory, or KITTI's ground truth.

TUM: a line is ``stamp tx ty tz qx qy qz qw``, seconds, metres and a quaternion; x and y are the
ground and the yaw is the vehicle's forward axis x (REP 103), or they are a camera's, which looks
along z and has x on its right, if somebody says so. KITTI: a line is a 3 × 4 matrix, row by row, of
the left camera in the first frame's, likewise; each frame has its line. A line that starts with #
is a remark, and commas will do for spaces.
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
"""No metres, seconds or part of a rotation are as many."""


@dataclass(frozen=True)
class PoseFile:
    """The poses of a file, by the time, or by the number of the frame where ``numbered``.

    Attributes:
        trajectory: of the poses.
        numbered: whether line i is of frame i.
        poses: (N, 3) float64, x, y and yaw, a row for each line.
    """

    trajectory: Trajectory
    numbered: bool
    poses: NDArray[np.float64]

    def key(self, index: int, stamp_ns: int) -> int:
        """Return where in the trajectory a frame is."""
        return index * _NUMBERED_NS if self.numbered else stamp_ns

    def by_number(self) -> Self:
        """Return the same poses by the number of the frame."""
        return type(self)(_numbered(self.poses), True, self.poses)


def read_pose_file(path: Path, axes: PoseAxes | None = None) -> PoseFile:
    """Read the poses of a file; without axes, TUM's are the vehicle's and KITTI's the camera's.

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
    if max(map(abs, numbers)) >= LARGEST:
        raise ValueError(f"a number is {max(numbers, key=abs):g}, beyond all metres and seconds")
    return numbers
