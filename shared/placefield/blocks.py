"""Blocks of the rows of large arrays."""

from collections.abc import Iterator


def blocks(count: int, size: int) -> Iterator[slice]:
    """Divide so many rows into blocks of a size; the last one may be smaller."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))
