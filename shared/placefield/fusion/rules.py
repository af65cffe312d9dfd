"""Candidates to match, one function per rule."""

from collections.abc import Collection, Sequence

import numpy as np

from placefield.config import MatchingConfig
from placefield.fusion.match import Match
from placefield.matching.candidate import UNANSWERED, Candidate

_NO_MATCH = (UNANSWERED, 0.0)


def fuse(
    candidates: Sequence[Candidate], config: MatchingConfig, *, missing: Collection[int] = ()
) -> Match:
    """Make one match of the candidates that arrived, in the order of their channels."""
    answered = [candidate for candidate in candidates if candidate.place != UNANSWERED]
    if not answered:
        place, score = _NO_MATCH
    elif config.rule == "evidence":
        place, score = _mean_evidence(answered, config.neighbourhood)
    else:
        place, score = _lowest_score(answered)
    return Match(place, score, tuple(sorted(missing)))


def _lowest_score(candidates: Sequence[Candidate]) -> tuple[int, float]:
    """Pick the candidate of the lowest fine score (Eq. 16)."""
    best = min(candidates, key=lambda candidate: candidate.score)
    return best.place, -best.score


def _mean_evidence(candidates: Sequence[Candidate], neighbourhood: int) -> tuple[int, float]:
    """Pick the place of lowest mean evidence; its score is the margin to the best one elsewhere."""
    evidence = np.stack([c.evidence for c in candidates]).mean(axis=0, dtype=np.float64)
    place = int(np.argmin(evidence))
    before = evidence[: max(place - neighbourhood, 0)]
    after = evidence[place + neighbourhood + 1 :]
    elsewhere = min(before.min(initial=np.inf), after.min(initial=np.inf))
    if elsewhere == np.inf:
        return place, 0.0  # the map is one neighbourhood: nothing tells the match from chance
    return place, float(elsewhere - evidence[place])
