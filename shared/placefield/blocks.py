"""Rows of large arrays, some at a time."""

from collections.abc import Iterator


def blocks(count: int, size: int) -> Iterator[slice]:
    """Cut so many rows into blocks of a size; the last one may be smaller."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))
