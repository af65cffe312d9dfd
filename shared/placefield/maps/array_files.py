"""Safe reading of a map's files: none outside the folder, and no more bytes than a file holds."""

import math
import mmap
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

_MAPPED_FROM = 2**20  # bytes: a smaller file is copied, so later changes to it do not matter


def open_inside(folder: Path, name: str) -> BinaryIO:
    """Open a regular file of a folder.

    Raises:
        OSError: it is missing, unreadable or no regular file, or a link leads out of the folder.
    """
    real = Path(os.path.realpath(folder / name, strict=True))
    if not real.is_relative_to(os.path.realpath(folder)):
        raise OSError(f"{folder / name}: a link leads out of the folder")
    opened = os.open(real, os.O_RDONLY | os.O_NONBLOCK)  # so that a pipe does not block
    if not stat.S_ISREG(os.fstat(opened).st_mode):
        os.close(opened)
        raise OSError(f"{folder / name}: no regular file")
    return os.fdopen(opened, "rb")


@dataclass(frozen=True)
class ArrayHeader:
    """The header of an array's file.

    Attributes:
        shape: of the array.
        is_turned: whether the array is stored column by column.
        dtype: of its numbers.
        start: offset of the first number, bytes.
    """

    shape: tuple[int, ...]
    is_turned: bool
    dtype: np.dtype[Any]
    start: int


class ArrayFile:
    """A ``.npy`` file; a large one is memory-mapped, so that all processes of a host share it.

    The file is closed when this object is collected, because a map is never closed explicitly.
    """

    def __init__(self, file: BinaryIO) -> None:
        """Remember the file's present length and time of change."""
        self._file = file
        self._closing = finalize(self, file.close)
        self._state = self._state_now()
        self.is_mapped = self._state[0] >= _MAPPED_FROM

    def _state_now(self) -> tuple[int, int]:
        status = os.fstat(self._file.fileno())
        return status.st_size, status.st_mtime_ns

    def close(self) -> None:
        """Close the file; mapped arrays stay valid."""
        self._closing()

    @property
    def length(self) -> int:
        """Length of the file, bytes."""
        return self._state[0]

    @property
    def is_unchanged(self) -> bool:
        """Whether the file was not written to since; a write changes mapped arrays, too."""
        return self._state_now() == self._state

    def header(self) -> ArrayHeader | None:
        """Return the header; None if the file is not an array of numbers as ``np.save`` writes it.

        The array of a valid header has exactly as many bytes as the file holds.
        """
        try:
            shape, is_turned, dtype = _read_header(self._file)
        except ValueError:
            return None
        start = self._file.tell()
        is_all = start + math.prod(shape) * dtype.itemsize == self.length
        return (
            ArrayHeader(shape, is_turned, dtype, start) if is_all and not dtype.hasobject else None
        )

    def array(self, header: ArrayHeader) -> NDArray[Any]:
        """Return the array of this header, read-only.

        Raises:
            OSError: the file has become shorter.
        """
        try:
            values = np.frombuffer(self._content(), header.dtype, offset=header.start)
            return values.reshape(header.shape, order="F" if header.is_turned else "C")
        except ValueError:
            raise OSError("shorter than it was") from None

    def _content(self) -> bytes | mmap.mmap:
        if self.is_mapped:
            return mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        return os.pread(self._file.fileno(), _MAPPED_FROM, 0)


def _read_header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError("not of version 1.0")
    try:
        shape, is_turned, dtype = np.lib.format.read_array_header_1_0(file)
    except (
        Exception
    ) as error:  # numpy parses the header as a Python literal, which raises errors of any kind
        raise ValueError(f"its header: {error}") from None
    if any(length < 0 for length in shape):
        raise ValueError("a length below 0")
    return shape, is_turned, dtype
