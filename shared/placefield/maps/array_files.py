"""Reading a map's files, whoever wrote them: only such as lie in it, and no more than they hold."""

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

_MAPPED_FROM = 2**20  # bytes: a smaller file is read, and what becomes of it then is no matter


def open_inside(folder: Path, name: str) -> BinaryIO:
    """Open a regular file of a folder.

    Raises:
        OSError: it is missing, unreadable or no regular file, or a link leads out of the folder.
    """
    real = Path(os.path.realpath(folder / name, strict=True))
    if not real.is_relative_to(os.path.realpath(folder)):
        raise OSError(f"{folder / name}: a link leads out of the folder")
    opened = os.open(real, os.O_RDONLY | os.O_NONBLOCK)  # no pipe is waited for
    if not stat.S_ISREG(os.fstat(opened).st_mode):
        os.close(opened)
        raise OSError(f"{folder / name}: no regular file")
    return os.fdopen(opened, "rb")


@dataclass(frozen=True)
class ArrayHeader:
    """What the file of an array says of it.

    Attributes:
        shape: of the array.
        is_turned: whether it lies column by column.
        dtype: of its numbers.
        start: where they begin, bytes.
    """

    shape: tuple[int, ...]
    is_turned: bool
    dtype: np.dtype[Any]
    start: int


class ArrayFile:
    """A ``.npy`` file; one that is large is mapped, so that all processes of a host share it.

    The file is closed with its last holder: a map has no end at which somebody could do it.
    """

    def __init__(self, file: BinaryIO) -> None:
        """Take the file as it is now."""
        self._file = file
        self._closing = finalize(self, file.close)
        self._state = self._state_now()
        self.is_mapped = self._state[0] >= _MAPPED_FROM

    def _state_now(self) -> tuple[int, int]:
        status = os.fstat(self._file.fileno())
        return status.st_size, status.st_mtime_ns

    def close(self) -> None:
        """Let go of the file; what is mapped stays."""
        self._closing()

    @property
    def length(self) -> int:
        """Bytes of the file."""
        return self._state[0]

    @property
    def is_unchanged(self) -> bool:
        """Whether nobody has written to the file since; what is mapped has changed with it."""
        return self._state_now() == self._state

    def header(self) -> ArrayHeader | None:
        """Return what the file says of its array, which is as many bytes as lie in the file.

        None: the file is none as ``np.save`` writes one of numbers.
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
        """Return the array of this header, which cannot be written to.

        Raises:
            OSError: the file is shorter now.
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
    ) as error:  # the header is parsed as a literal of Python, which fails in all ways
        raise ValueError(f"its header: {error}") from None
    if any(length < 0 for length in shape):
        raise ValueError("a length below 0")
    return shape, is_turned, dtype
