"""Files that appear whole or not at all: what cannot be written leaves what was there."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a path beside a file, to be written inside the block; it takes its place at the end.

    It is with the disk by then. A device or a pipe is written to as it is.

    Raises:
        OSError: it cannot be written.
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
        OSError: it cannot be written.
    """
    with written_whole(path) as beside:
        beside.write_bytes(content.encode() if isinstance(content, str) else content)


def sync(file: Path) -> None:
    """Wait until a file is with the disk.

    Raises:
        OSError: the disk refuses it.
    """
    with file.open("rb") as opened:
        os.fsync(opened.fileno())


def named(error: OSError, path: Path) -> OSError:
    """Return an error that names a file; that of a disk that is full does not."""
    return OSError(error.errno, error.strerror or str(error), str(path))
