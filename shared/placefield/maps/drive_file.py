"""The file of a drive that is being explored: its frames, as a map will need them.

It is a sequence of msgpack lists: one about the drive, then one for each frame. A frame is appended
at once and as a whole, so a process that dies loses at most the frame that it was writing; that
frame is removed when the file is opened again.
"""

import logging
import os
import threading
from array import array
from bisect import bisect_left
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgpack
import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.files import named
from placefield.locking import take_lock

log = logging.getLogger(__name__)

_KIND, _VERSION = "placefield drive", 1


class Drive(NamedTuple):
    """A drive: the name of its stream, whether that is live, and the feature's fingerprint."""

    stream: str
    live: bool
    feature: str


class DriveFrame(NamedTuple):
    """A frame of a drive.

    Attributes:
        number: in the stream; numbers ascend, and frames may be missing.
        stamp_ns: when it was taken, nanoseconds.
        odometry_m: the odometry, metres; None if unknown.
        raw: (D,) float32, the raw feature; None if it was not observed.
        thumbnail: JPEG; empty if there is none.
    """

    number: int
    stamp_ns: int
    odometry_m: float | None
    raw: NDArray[np.float32] | None
    thumbnail: bytes


class DriveFile:
    """A drive on disk, to be appended to. One thread may append while others read.

    In memory, a frame takes 16 bytes, as long as the file is open.
    """

    def __init__(self, path: Path, drive: Drive | None = None) -> None:
        """Open the file of a drive, or create that of a new one; it is locked until it is closed.

        Args:
            path: of the file.
            drive: the new drive; None: the file exists.

        Raises:
            MapError: the file is of no drive, or another process has it open.
            OSError: the file cannot be read or written.
        """
        self._path = path
        self._file = path.open("rb+" if drive is None else "xb+", buffering=0)
        self._numbers = array("q")
        self._ends = array("q")  # of the records, the first one included
        self._lock = threading.Lock()  # held while the file is read or closed
        if not take_lock(self._file):
            raise MapError(f"{path}: another process is exploring this drive")
        if drive is None:
            self.drive = self._read_again()
        else:
            self.drive = drive
            self._write([_KIND, _VERSION, *drive])

    @property
    def next(self) -> int:
        """The number after that of the last frame."""
        return self._numbers[-1] + 1 if self._numbers else 0

    def append(self, frame: DriveFrame) -> None:
        """Append a frame whose number is ``next`` or higher.

        Raises:
            OSError: the disk is full, or fails; the file is as before.
        """
        raw = None if frame.raw is None else frame.raw.astype("<f4").tobytes()
        self._write([*frame[:3], raw, frame.thumbnail])
        self._numbers.append(frame.number)

    def frames(self, first: int, end: int) -> Iterator[DriveFrame]:
        """Yield the frames that have the numbers ``first`` to ``end`` - 1.

        Raises:
            OSError: the file cannot be read.
        """
        numbers = self._numbers
        for row in range(bisect_left(numbers, first), bisect_left(numbers, end)):
            start, length = self._ends[row], self._ends[row + 1] - self._ends[row]
            with self._lock:
                if self._file.closed:
                    return
                record = os.pread(self._file.fileno(), length, start)
            yield _frame_of(msgpack.unpackb(record))

    def end(self, path: Path) -> None:
        """Move the file to another path: the drive is over. It can still be read.

        Raises:
            OSError: the disk fails.
        """
        os.fsync(self._file.fileno())
        self._path.rename(path)

    def close(self) -> None:
        """Close the file; no more frames are read from it."""
        with self._lock:
            self._file.close()

    def _write(self, record: list[Any]) -> None:
        packed: bytes = msgpack.packb(record)
        start = self._ends[-1] if self._ends else 0
        try:
            written = os.pwrite(self._file.fileno(), packed, start)
            while written < len(packed):
                written += os.pwrite(self._file.fileno(), packed[written:], start + written)
        except OSError as error:
            self._file.truncate(start)
            raise named(error, self._path) from None
        self._ends.append(start + len(packed))

    def _read_again(self) -> Drive:
        """Find the records of an existing file, and remove an incomplete last one.

        Raises:
            MapError: the file is of no drive.
        """
        drive, end = None, 0
        for record, end in _records(self._path):
            if drive is None:
                drive = _drive_of(record, self._path)
            else:
                self._numbers.append(_frame_of(record).number)
            self._ends.append(end)
        if drive is None:
            raise MapError(f"{self._path}: is no drive; remove it")
        if end < self._path.stat().st_size:
            log.warning("%s: the last frame was written in part, and is removed", self._path)
            self._file.truncate(end)
        return drive


def read_drive(path: Path) -> Iterator[DriveFrame]:
    """Yield the frames of a drive, from its file.

    Raises:
        MapError: the file is of no drive.
        OSError: the file cannot be read.
    """
    records = _records(path)
    about, _ = next(records, (None, 0))
    _drive_of(about, path)
    for record, _ in records:
        yield _frame_of(record)


def _records(path: Path) -> Iterator[tuple[Any, int]]:
    """Yield each complete record and where it ends."""
    with path.open("rb") as file:
        unpacker = msgpack.Unpacker(file, max_buffer_size=2**30)
        try:
            for record in unpacker:
                yield record, unpacker.tell()
        except (ValueError, msgpack.UnpackException):
            return


def _drive_of(record: Any, path: Path) -> Drive:
    match record:
        case [kind, version, str(stream), bool(live), str(feature)] if kind == _KIND:
            if version != _VERSION:
                raise MapError(f"{path}: of another version of Placefield; remove it")
            return Drive(stream, live, feature)
    raise MapError(f"{path}: is no drive; remove it")


def _frame_of(record: list[Any]) -> DriveFrame:
    number, stamp_ns, odometry_m, raw, thumbnail = record
    feature = None if raw is None else np.frombuffer(raw, "<f4")
    return DriveFrame(number, stamp_ns, odometry_m, feature, thumbnail)
