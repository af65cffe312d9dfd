"""A ``frames.csv``: which files of a folder are the frames, and when and where they were taken.

The header names ``file`` and any of ``stamp`` (seconds), ``odometry`` (metres travelled since any
fixed start, 0 or more), ``x`` and ``y`` (metres, together) or ``latitude`` and ``longitude``
(degrees, together), and with these ``yaw`` (radians, counterclockwise from x or from the east). The
rows are in the order in which the frames were taken. All cells of an unknown pose are empty; 0, 0
degrees, which receivers give without a fix, is an unknown pose, too. Without a yaw, the direction
of travel is used.

The table beside a file of descriptors has a row for each of them. It needs no ``file``, and the
files that it may name are not looked at.
"""

import csv
import math
from dataclasses import replace
from pathlib import Path

from placefield.errors import SourceError
from placefield_tools.sources.degrees import is_fix
from placefield_tools.sources.listing import (
    DefaultStamp,
    Listed,
    Listing,
    Position,
    with_positions,
)
from placefield_tools.sources.regular_files import check_inside
from placefield_tools.sources.seconds import nanoseconds

_METRES, _DEGREES = ("x", "y"), ("latitude", "longitude")

COLUMNS = ("file", "stamp", "odometry", *_METRES, *_DEGREES, "yaw")

Row = dict[str, str]


def read_frames_csv(
    path: Path, default_stamp_ns: DefaultStamp, *, of_files: bool = True
) -> Listing:
    """Read a ``frames.csv``.

    Args:
        path: of the table.
        default_stamp_ns: without a stamp column, frame i's stamp is ``default_stamp_ns(i)``.
        of_files: whether the rows name files, which must be in the folder.

    Raises:
        SourceError: the header or a row is malformed, a stamp or the odometry descends, or a listed
            file is missing; the error names the line.
    """
    header, rows = _rows(path, of_files)
    in_degrees = _DEGREES[0] in header
    frames: list[Listed] = []
    positions: list[Position | None] = []
    yaws: list[float] = []
    for line, row in rows:
        try:
            frame = _listed(row, default_stamp_ns(len(frames)))
            if frames:
                _check_order(frames[-1], frame)
            if of_files:
                _check_file(path.parent, frame.file)
            frames.append(frame)
            position, yaw = _place(row, _DEGREES if in_degrees else _METRES)
            positions.append(
                None if in_degrees and position and not is_fix(*position) else position
            )
            yaws.append(yaw)
        except ValueError as error:
            raise SourceError(f"{path}, line {line}: {error}") from error
    if not frames:
        raise SourceError(f"{path}: lists no frames; fill it, or remove it to use all frames")
    try:
        listing = with_positions(
            frames, positions, yaws if "yaw" in header else None, in_degrees=in_degrees
        )
        return replace(listing, stamped="stamp" in header)
    except ValueError as error:
        raise SourceError(f"{path}: {error}") from error


def _check_file(folder: Path, name: str) -> None:
    check_inside(name)
    if not (folder / name).is_file():
        raise ValueError(f"there is no file {name!r} in the folder")


def _rows(path: Path, of_files: bool) -> tuple[list[str], list[tuple[int, Row]]]:
    """Return the columns, and for each row that is not empty its line number and cells."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as lines:
            reader = csv.reader(lines, strict=True)
            table = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SourceError(f"{path}: cannot be read as a table ({error})") from error
    header = table[0][1] if table else []
    _check_header(path, header, of_files)
    for line, row in table[1:]:
        if len(row) != len(header):
            raise SourceError(
                f"{path}, line {line}: has {len(row)} cells, and the header has {len(header)}"
            )
    return header, [(line, dict(zip(header, row, strict=True))) for line, row in table[1:]]


def _check_header(path: Path, header: list[str], of_files: bool) -> None:
    known = set(header) <= set(COLUMNS) and len(set(header)) == len(header)
    if not known or not header or (of_files and "file" not in header):
        first, others = "file and " if of_files else "", ", ".join(COLUMNS[1:])
        raise SourceError(f"{path}, line 1: the header must be {first}any of {others}")
    has_pose = [pair for pair in (_METRES, _DEGREES) if {*pair} & {*header}]
    if len(has_pose) > 1:
        raise SourceError(f"{path}, line 1: give x and y, or latitude and longitude, not both")
    if not all({*pair} <= {*header} for pair in has_pose) or ("yaw" in header and not has_pose):
        raise SourceError(
            f"{path}, line 1: a pose needs the columns x and y, or latitude and longitude"
        )


def _check_order(before: Listed, frame: Listed) -> None:
    if frame.stamp_ns < before.stamp_ns:
        raise ValueError("the stamp is earlier than the one before")
    # Either all rows have an odometry or none has.
    if (frame.odometry_m or 0.0) < (before.odometry_m or 0.0):
        raise ValueError("the odometry is less than the one before")


def _listed(row: Row, default_stamp_ns: int) -> Listed:
    stamp_ns = nanoseconds(row["stamp"]) if "stamp" in row else default_stamp_ns
    odometry_m = _number(row, "odometry") if "odometry" in row else None
    if odometry_m is not None and odometry_m < 0:
        raise ValueError(f"the odometry is {odometry_m:g}, less than 0")
    return Listed(row.get("file", ""), stamp_ns, odometry_m=odometry_m)


def _place(row: Row, columns: tuple[str, str]) -> tuple[Position | None, float]:
    """Return the position, None if unknown, and the yaw, 0 if unknown."""
    if not any(row.get(column) for column in (*columns, "yaw")):
        return None, 0.0
    position = _number(row, columns[0]), _number(row, columns[1])
    return position, _number(row, "yaw") if "yaw" in row else 0.0


def _number(row: Row, column: str) -> float:
    try:
        number = float(row[column])
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{column} is {row[column]!r}, which is no finite number")
    return number
