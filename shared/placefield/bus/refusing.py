"""How messages that are refused are counted."""

from collections import Counter

from placefield.errors import MessageError, OtherMapError


def count_refused(counts: Counter[str], error: MessageError) -> None:
    """Count a message that was refused: as ``other_map`` if it is of one, else as ``malformed``."""
    if isinstance(error, OtherMapError):
        counts["other_map"] += 1
    else:
        counts["malformed"] += 1
