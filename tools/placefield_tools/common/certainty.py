"""How certain a match is, in words for people."""

import math

from placefield.bus.messages import MatchMessage
from placefield.fusion.match import FASTER, Match


def certainty_of(match: Match | MatchMessage) -> str | None:
    """Return ``known``, ``likely``, ``unknown``, or that the vehicle is faster than the map.

    A match that is not known is likely where it is more likely right than wrong. The result is None
    where the rule gives no probability.
    """
    if match.too_fast:
        return FASTER
    if match.known or match.known is None:
        return "known" if match.known else None
    return "likely" if (match.probability or 0.0) > 0.5 else "unknown"


def percent(probability: float) -> str:
    """Return a probability from 0 to 1 as ``98.6 %``, rounded down.

    Rounding down keeps a match that just misses the precision below it.
    """
    return f"{math.floor(probability * 1000 + 1e-6) / 10:.1f} %"
