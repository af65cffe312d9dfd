"""Files that appear completely or not at all: a failed write leaves the old file."""

import ctypes
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_HERE, _EXCHANGE = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside a file, to be written inside the block; it replaces the file.

    It is synced to the disk before that. A device or a pipe is written to directly.

    Raises:
        OSError: the file cannot be written.
    """
    real = Path(os.path.realpath(path))
    if real.exists() and not real.is_file():
        yield real
        return
    beside = real.with_name(f".{real.name}.{uuid.uuid4().hex[:8]}")
    try:
        yield beside
        sync(beside)
        beside.replace(real)
    except OSError as error:
        raise named(error, path) from None
    finally:
        beside.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file; text as UTF-8.

    Raises:
        OSError: the file cannot be written.
    """
    with written_whole(path) as beside:
        beside.write_bytes(content.encode() if isinstance(content, str) else content)


def exchange(one: Path, other: Path) -> None:
    """Exchange two files or folders; at no instant is one of them missing.

    Only Linux offers this, by ``renameat2``, and Python has no function for it.

    Raises:
        OSError: one is missing, or the system or the file system cannot do it.
    """
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):
        raise OSError("this system cannot exchange two files") from None
    names = _HERE, os.fsencode(one), _HERE, os.fsencode(other)
    if rename(*names, _EXCHANGE):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), str(one))


def sync(file: Path) -> None:
    """Wait until a file is on the disk.

    Raises:
        OSError: the disk refuses it.
    """
    with file.open("rb") as opened:
        os.fsync(opened.fileno())


def named(error: OSError, path: Path) -> OSError:
    """Return the error with the path of the file, which the error of a full disk lacks."""
    return OSError(error.errno, error.strerror or str(error), str(path))
