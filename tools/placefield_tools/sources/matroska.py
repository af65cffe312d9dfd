"""A check for Matroska files (MKV and WebM) that are cut off (RFC 8794 and 9559)."""

from pathlib import Path

_EBML = b"\x1a\x45\xdf\xa3"


def is_matroska(head: bytes) -> bool:
    """Return whether the first bytes of a file are those of Matroska."""
    return head.startswith(_EBML)


def ends_too_early(path: Path) -> bool:
    """Return whether the file is shorter than the stated length of its segment of frames.

    A file that was written as a stream states no length, and never ends too early.
    """
    segment = _end_of_element(path, 0)
    end = None if segment is None else _end_of_element(path, segment)
    return end is not None and end > path.stat().st_size


def _end_of_element(path: Path, at: int) -> int | None:
    """Return the end of the element that begins at an offset; None if it states no length."""
    with path.open("rb") as file:
        file.seek(at)
        head = file.read(12)  # at most 4 bytes of an ID and 8 bytes of a length
    name = _width(head[:1])
    width = _width(head[name : name + 1])
    digits = head[name : name + width]
    length = int.from_bytes(digits, "big") & ((1 << 7 * width) - 1)
    is_unknown = length == (1 << 7 * width) - 1
    return None if is_unknown or len(digits) < width else at + name + width + length


def _width(first: bytes) -> int:
    """Return the width of a number in bytes, by the leading zeros of its first byte."""
    return 9 - first[0].bit_length() if first else 9
