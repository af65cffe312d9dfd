"""Counts refused messages."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from placefield.errors import MessageError, OtherMapError


@contextmanager
def counting_refused(counts: Counter[str]) -> Iterator[None]:
    """Count the message that is refused in the block, if one is, and go on after it."""
    try:
        yield
    except MessageError as error:
        count_refused(counts, error)


def count_refused(counts: Counter[str], error: MessageError) -> None:
    """Count a refused message: as ``other_map`` if it is of another map, else as ``malformed``."""
    if isinstance(error, OtherMapError):
        counts["other_map"] += 1
    else:
        counts["malformed"] += 1
