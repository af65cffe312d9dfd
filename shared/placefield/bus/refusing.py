"""Counts refused messages."""

from collections import Counter

from placefield.errors import MessageError, OtherMapError


def count_refused(counts: Counter[str], error: MessageError) -> None:
    """Count a refused message: as ``other_map`` if it is of another map, else as ``malformed``."""
    if isinstance(error, OtherMapError):
        counts["other_map"] += 1
    else:
        counts["malformed"] += 1
