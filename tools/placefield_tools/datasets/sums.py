"""Checksums of the first download, as ``sha256sum`` writes them, of files without a known one.

They do not prove that the files were right, but that later downloads are the same.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

from placefield.errors import SourceError
from placefield.files import write_whole

_LINE = re.compile(r"([0-9a-f]{64})  (.+)")


def sum_of(file: Path) -> str:
    """Return the SHA-256 of a file, in lower-case hexadecimal digits."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def read_sums(path: Path) -> dict[str, str]:
    """Return the sums in a list by the files' names; empty if there is no list.

    Raises:
        SourceError: the file is not what ``sha256sum`` writes.
    """
    if not path.exists():
        return {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        lines = [""]
    found = [_LINE.fullmatch(line) for line in lines]
    if None in found:
        raise SourceError(f"{path}: is not a list of SHA-256 sums; remove it to begin a new list")
    return {match[2]: match[1] for match in found if match}


def write_sums(path: Path, sums: Mapping[str, str]) -> None:
    """Write a list of sums, atomically.

    Raises:
        OSError: the list cannot be written.
    """
    write_whole(path, "".join(f"{digest}  {name}\n" for name, digest in sums.items()))
