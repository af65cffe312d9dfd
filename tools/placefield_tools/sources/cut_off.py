"""A check for recordings that are cut off, for example by a killed recorder or a full disk."""

from pathlib import Path
from typing import BinaryIO

_MCAP_MAGIC = b"\x89MCAP0\r\n"
_BAG_MAGIC = b"#ROSBAG V2.0\n"
_SQLITE_HEADER = 100  # bytes


def is_cut_off(path: Path) -> bool:
    """Return whether a file of a recording, or one in its folder, is cut off.

    Only a recording that cannot be read is checked.
    """
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return any(_file_is_cut_off(file) for file in files)


def _file_is_cut_off(path: Path) -> bool:
    check = {".mcap": _mcap, ".bag": _bag, ".db3": _sqlite}.get(path.suffix.lower())
    if check is None:
        return False
    try:
        with path.open("rb") as file:
            return check(file, path.stat().st_size)
    except (OSError, ValueError):
        return False


def _mcap(file: BinaryIO, size: int) -> bool:
    if size < len(_MCAP_MAGIC):
        return True
    is_mcap = file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC
    file.seek(-len(_MCAP_MAGIC), 2)
    return is_mcap and (size <= len(_MCAP_MAGIC) or file.read() != _MCAP_MAGIC)


def _bag(file: BinaryIO, size: int) -> bool:
    """Follow the records to the end; each is a header and data, both preceded by a length."""
    if size < len(_BAG_MAGIC):
        return True
    if file.read(len(_BAG_MAGIC)) != _BAG_MAGIC:
        return False
    at = len(_BAG_MAGIC)
    while at < size:
        for _ in ("header", "data"):
            file.seek(at)
            length = file.read(4)
            if len(length) < 4:
                return True
            at += 4 + int.from_bytes(length, "little")
    return at > size or at == len(_BAG_MAGIC)


def _sqlite(file: BinaryIO, size: int) -> bool:
    header = file.read(_SQLITE_HEADER)
    if len(header) < _SQLITE_HEADER:
        return True
    page = int.from_bytes(header[16:18], "big")
    pages = int.from_bytes(header[28:32], "big")
    return size < pages * (65536 if page == 1 else page)
