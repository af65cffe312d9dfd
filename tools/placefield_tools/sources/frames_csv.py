"""A folder's ``frames.csv``: which files are the frames, when and where each was taken.

The header names ``file`` and any of ``stamp`` (seconds), ``odometry`` (metres travelled since any
fixed start), ``x`` and ``y`` (metres, together) and ``yaw`` (radians, with x and y; 0 where there
is no such column). The rows are in the order in which the frames were taken. A frame whose pose is
not known leaves all the pose's cells empty.
"""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from placefield.errors import SourceError
from placefield.features.frames import Pose

COLUMNS = ("file", "stamp", "odometry", "x", "y", "yaw")

Row = dict[str, str]


@dataclass(frozen=True, slots=True)
class Listed:
    """A frame whose image has not been read yet; ``file`` is relative to the folder."""

    file: str
    stamp_ns: int
    pose: Pose | None = None
    odometry_m: float | None = None


def read_frames_csv(path: Path, default_stamp_ns: Callable[[int], int]) -> list[Listed]:
    """Read a ``frames.csv``; without a stamp column, frame i's stamp is ``default_stamp_ns(i)``.

    Raises SourceError, naming the line, where a row or the header is malformed, a stamp or the
    odometry goes back, or a listed file is missing.
    """
    frames: list[Listed] = []
    for line, row in _rows(path):
        try:
            stamp_ns = _stamp_ns(row) if "stamp" in row else default_stamp_ns(len(frames))
            odometry_m = _number(row, "odometry") if "odometry" in row else None
            frame = Listed(row["file"], stamp_ns, _pose(row), odometry_m)
            if frames:
                _check_order(frames[-1], frame)
            if not (path.parent / row["file"]).is_file():
                raise ValueError(f"there is no file {row['file']!r} in the folder")
            frames.append(frame)
        except ValueError as error:
            raise SourceError(f"{path}, line {line}: {error}") from error
    if not frames:
        raise SourceError(f"{path}: lists no frames; fill it, or remove it to use all images")
    return frames


def _rows(path: Path) -> list[tuple[int, Row]]:
    """Return (line number, cells by column) of each row that is not empty."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as lines:
            reader = csv.reader(lines, strict=True)
            table = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SourceError(f"{path}: cannot be read as a table ({error})") from error
    header = table[0][1] if table else []
    _check_header(path, header)
    for line, row in table[1:]:
        if len(row) != len(header):
            raise SourceError(f"{path}, line {line}: {len(row)} cells, the header {len(header)}")
    return [(line, dict(zip(header, row, strict=True))) for line, row in table[1:]]


def _check_header(path: Path, header: list[str]) -> None:
    known = set(header) <= set(COLUMNS) and len(set(header)) == len(header)
    if not known or "file" not in header:
        others = ", ".join(COLUMNS[1:])
        raise SourceError(f"{path}, line 1: the header must be file and any of {others}")
    if ("x" in header) != ("y" in header) or ("yaw" in header and "x" not in header):
        raise SourceError(f"{path}, line 1: a pose needs the columns x and y")


def _check_order(before: Listed, frame: Listed) -> None:
    if frame.stamp_ns < before.stamp_ns:
        raise ValueError("the stamp is earlier than the one before")
    # Either all rows have an odometry or none has.
    if (frame.odometry_m or 0.0) < (before.odometry_m or 0.0):
        raise ValueError("the odometry is less than the one before")


def _stamp_ns(row: Row) -> int:
    """Return the stamp in ns, by way of Decimal: as float, an epoch's ns would be rounded."""
    try:
        stamp_ns = round(Decimal(row["stamp"]) * 1_000_000_000)
    except (ArithmeticError, ValueError):
        stamp_ns = -1
    if not 0 <= stamp_ns < 2**63:
        raise ValueError(f"the stamp {row['stamp']!r} must be a number of seconds from 0 up")
    return stamp_ns


def _pose(row: Row) -> Pose | None:
    cells = [row[column] for column in ("x", "y", "yaw") if column in row]
    if not any(cells):
        return None
    return Pose(_number(row, "x"), _number(row, "y"), _number(row, "yaw") if "yaw" in row else 0.0)


def _number(row: Row, column: str) -> float:
    try:
        number = float(row[column])
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{column} is {row[column]!r}, no finite number")
    return number
