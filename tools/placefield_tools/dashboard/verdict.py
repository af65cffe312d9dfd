"""What an answer comes to, in words for people."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from placefield.bus.messages import MatchMessage
from placefield_tools.common.certainty import certainty_of, percent
from placefield_tools.dashboard.answer import Answer

Kind = Literal["known", "likely", "unknown", "plain"]
"""How a verdict is marked: one may act on it, perhaps, one may not, or the rule does not say."""

_FIRST = 20  # frames of a stream, in which a vehicle may not be found yet
_ON_ROUTE = 0.5  # belief in all places of the map


@dataclass(frozen=True)
class Verdict:
    """What an answer comes to.

    Attributes:
        words: for people.
        kind: how it is marked.
    """

    words: str
    kind: Kind


def kind_of(match: MatchMessage) -> Kind:
    """Return how a match is marked."""
    certainty = certainty_of(match)
    if certainty is None or match.place < 0:
        return "plain"
    if certainty == "known":
        return "known"
    return "likely" if certainty == "likely" else "unknown"


def verdict_of(answer: Answer, precision: float) -> Verdict:
    """Say what an answer comes to.

    Args:
        answer: of a frame.
        precision: the probability from which on a match is known.
    """
    match, words, kind = answer.match, verdict_name(answer), kind_of(answer.match)
    if match.probability is None or words != certainty_of(match) or match.too_fast:
        return Verdict(words, kind)
    asked = "" if match.known else f" ({100 * precision:g} % asked)"
    return Verdict(f"{words}, {percent(match.probability)}{asked}", kind)


def verdict_name(answer: Answer) -> str:
    """Say what an answer comes to, without figures."""
    certainty = certainty_of(answer.match)
    if answer.match.place < 0:
        return "no place"
    if certainty is None:
        return "matched"
    if certainty == "unknown" and _is_off_route(answer):
        found = answer.header.sequence >= _FIRST
        return "not on this route" if found else "looking for the place"
    return certainty


def belief_of(answer: Answer) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return the mean belief of the channels: places (n,), ascending, and the belief in each.

    Only the rule ``filter`` has beliefs; under the others there are no places.
    """
    candidates = list(answer.candidates.values())
    if answer.rule != "filter" or not candidates:
        return np.empty(0, np.int32), np.empty(0)
    places = np.concatenate([each.places for each in candidates])
    beliefs = np.concatenate([each.evidence for each in candidates]) / len(candidates)
    distinct, which = np.unique(places, return_inverse=True)
    summed = np.bincount(which, beliefs, len(distinct)).astype(np.float64)
    return distinct.astype(np.int32), summed


def _is_off_route(answer: Answer) -> bool:
    if answer.rule != "filter" or not answer.candidates:
        return False
    return float(belief_of(answer)[1].sum()) < _ON_ROUTE
