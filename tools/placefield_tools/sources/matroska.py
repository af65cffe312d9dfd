"""Whether a Matroska file, which MKV and WebM are, ends before its end (RFC 8794 and 9559)."""

from pathlib import Path

_EBML = b"\x1a\x45\xdf\xa3"


def is_matroska(head: bytes) -> bool:
    """Return whether a file begins as Matroska does."""
    return head.startswith(_EBML)


def ends_too_early(path: Path) -> bool:
    """Return whether the file is shorter than its segment, which holds all frames, says.

    One that was written as a stream does not say so, and never ends too early.
    """
    segment = _end_of_element(path, 0)
    end = None if segment is None else _end_of_element(path, segment)
    return end is not None and end > path.stat().st_size


def _end_of_element(path: Path, at: int) -> int | None:
    """Return where the element that begins there ends; None where it does not say."""
    with path.open("rb") as file:
        file.seek(at)
        head = file.read(12)  # 4 bytes of a name and 8 of a length, at most
    name = _width(head[:1])
    width = _width(head[name : name + 1])
    digits = head[name : name + width]
    length = int.from_bytes(digits, "big") & ((1 << 7 * width) - 1)
    is_unknown = length == (1 << 7 * width) - 1
    return None if is_unknown or len(digits) < width else at + name + width + length


def _width(first: bytes) -> int:
    """Return how many bytes a number is wide, by the zeros that its first byte begins with."""
    return 9 - first[0].bit_length() if first else 9
