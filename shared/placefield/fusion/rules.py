"""Candidates to match, one function per rule."""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.fusion.match import Match
from placefield.matching.best_window import Vicinity, best_window
from placefield.matching.candidate import TOO_FAST, UNANSWERED, Candidate

_SUREST = 1 - 1e-12  # a belief of 1 has no finite log odds


def fuse(
    candidates: Sequence[Candidate],
    config: MatchingConfig,
    vicinity: Vicinity | None = None,
    missing: Collection[int] = (),
) -> Match:
    """Make one match of the candidates that arrived, in the order of their channels.

    Args:
        candidates: for one frame.
        config: by which they were made.
        vicinity: what is near a place, within the tolerance of ``config``; None: on one route whose
            places all differ.
        missing: channels that have no candidate.
    """
    vicinity = vicinity or Vicinity(config.tolerance)
    answered = [candidate for candidate in candidates if candidate.place != UNANSWERED]
    absent = tuple(sorted(missing))
    if not answered:
        return Match(UNANSWERED, 0.0, absent)
    if config.rule == "filter":
        place, probability = _mean_belief(answered, vicinity)
        score = log_odds(probability)
        too_fast = sum(each.too_fast for each in answered) / len(answered) >= TOO_FAST
        known = probability >= config.precision and not too_fast
        return Match(place, score, absent, probability, known, too_fast)
    if config.rule == "evidence":
        return Match(*_mean_evidence(answered, config.neighbourhood, vicinity.same), absent)
    return Match(*_ams(answered), absent)


def log_odds(probability: float) -> float:
    """Return the log odds of a probability, which are finite even at 0 and 1."""
    within = min(max(probability, 1 - _SUREST), _SUREST)
    return float(np.log(within) - np.log1p(-within))


def _ams(candidates: Sequence[Candidate]) -> tuple[int, float]:
    """Pick the candidate of the lowest fine score (Eq. 16)."""
    best = min(candidates, key=lambda candidate: candidate.score)
    return best.place, -best.score


def _mean_belief(candidates: Sequence[Candidate], vicinity: Vicinity) -> tuple[int, float]:
    """Pick the middle of the window of highest mean belief, see ``best_window``.

    Also return the mean belief that the vehicle is near the middle.
    """
    places = np.concatenate([candidate.places for candidate in candidates])
    beliefs = np.concatenate([candidate.evidence for candidate in candidates])
    order = np.argsort(places, kind="stable")
    place, around = best_window(places[order], beliefs[order], vicinity)
    return place, min(max(around / len(candidates), 1 - _SUREST), _SUREST)


def _mean_evidence(
    candidates: Sequence[Candidate], neighbourhood: int, same: NDArray[np.int32] | None
) -> tuple[int, float]:
    """Pick the place of lowest mean evidence; its score is the margin to the best place elsewhere.

    A place that is the same as a place of the neighbourhood is not elsewhere.
    """
    evidence = _mean(candidates)
    place = int(np.argmin(evidence))
    lowest = float(evidence[place])
    if same is not None:
        evidence[np.abs(same - same[place]) <= neighbourhood] = np.inf
    before = evidence[: max(place - neighbourhood, 0)]
    after = evidence[place + neighbourhood + 1 :]
    elsewhere = min(before.min(initial=np.inf), after.min(initial=np.inf))
    if elsewhere == np.inf:
        return place, 0.0  # the map is one neighbourhood: there is no margin
    return place, float(elsewhere - lowest)


def _mean(candidates: Sequence[Candidate]) -> NDArray[np.float64]:
    return np.asarray(np.stack([c.evidence for c in candidates]).mean(axis=0, dtype=np.float64))
