"""Checksums of a map's files. All cores compute them, so that a worker starts quickly."""

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

_PIECE = 2**20  # bytes that one thread reads and hashes at once


def checksum_of(file: Path) -> str:
    """Return the checksum of a file: the SHA-256 of the SHA-256s of its MiBs; hexadecimal.

    Raises:
        OSError: the file is missing or unreadable.
    """
    with file.open("rb") as opened:
        return checksum_of_opened(opened)


def checksum_of_opened(file: BinaryIO) -> str:
    """Return the checksum of an open file, see ``checksum_of``; its position does not change.

    Raises:
        OSError: the file is unreadable.
    """

    def digest(start: int) -> bytes:
        return hashlib.sha256(os.pread(file.fileno(), _PIECE, start)).digest()

    starts = range(0, os.fstat(file.fileno()).st_size, _PIECE)
    with ThreadPoolExecutor() as threads:
        return hashlib.sha256(b"".join(threads.map(digest, starts))).hexdigest()
