"""What an answer comes to, in words for people."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from placefield_tools.common.certainty import certainty_of, percent
from placefield_tools.dashboard.state import Answer

Kind = Literal["known", "unsure", "plain"]
"""The colour of a verdict: one may act on it, one may not, or the rule does not say."""

_FIRST = 20  # frames of a stream, in which a vehicle may not be found yet
_ON_ROUTE = 0.5  # belief in all places of the map


@dataclass(frozen=True)
class Verdict:
    """What an answer comes to.

    Attributes:
        words: for people.
        kind: the colour.
    """

    words: str
    kind: Kind


def verdict_of(answer: Answer, precision: float) -> Verdict:
    """Say what an answer comes to.

    Args:
        answer: of a frame.
        precision: the probability from which on a match is known.
    """
    match = answer.match
    certainty = certainty_of(match)
    if match.place < 0:
        return Verdict("no answer", "plain")
    if certainty is None:
        return Verdict("matched", "plain")
    if certainty == "unknown" and _is_off_route(answer):
        found = answer.header.sequence >= _FIRST
        return Verdict("not on this route" if found else "looking for the place", "unsure")
    if match.too_fast or match.probability is None:
        return Verdict(certainty, "unsure")
    if match.known:
        return Verdict(f"known, {percent(match.probability)}", "known")
    asked = f"({100 * precision:g} % asked)"
    return Verdict(f"{certainty}, {percent(match.probability)} {asked}", "unsure")


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
