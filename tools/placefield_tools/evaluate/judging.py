"""Compares matches with the ground truth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from placefield.evaluation.claims import Claims, claims
from placefield.evaluation.curves import PrecisionRecall, precision_recall
from placefield.evaluation.reliability import Reliability, reliability
from placefield.evaluation.truth import Truth
from placefield.fusion.match import Match, SmoothedMatch
from placefield.matching.candidate import UNANSWERED
from placefield_tools.common.certainty import certainty_of


@dataclass(frozen=True)
class Judged:
    """The matches of a query of Q frames, compared with the ground truth.

    Attributes:
        places: (Q,) int64, the matched place of each frame, -1 without a match.
        scores: (Q,) float64; a higher score is more certain.
        correct: (Q,) bool.
        curve: precision and recall.
        reliability: of the probabilities, if the method gives them.
        claims: the known matches, likewise.
        mean_lag: mean number of later frames that a match uses.
        certainties: of each match in words, see ``certainty_of``; None where the rule has none.
        first_known: number of the first known match, if there is one.
        too_fast: number of frames where the vehicle seems faster than the map resolves.
    """

    places: NDArray[np.int64]
    scores: NDArray[np.float64]
    correct: NDArray[np.bool_]
    curve: PrecisionRecall
    reliability: Reliability | None = None
    claims: Claims | None = None
    mean_lag: float = 0.0
    certainties: tuple[str | None, ...] = ()
    first_known: int | None = None
    too_fast: int = 0


def judge(matches: Sequence[Match], truth: Truth) -> Judged:
    """Compare matches with the ground truth, in the frames that have one."""
    places = np.array([match.place for match in matches], np.int64)
    scores = np.array([match.score for match in matches], np.float64)
    correct = truth.correct(places)
    answered = places != UNANSWERED
    judged = slice(None) if truth.judged is None else truth.judged
    on_route = truth.on_route[judged]
    curve = precision_recall(correct[judged], answered[judged], on_route, scores[judged])
    if not any(match.known is not None for match in matches):
        return Judged(places, scores, correct, curve)
    probability = np.array([match.probability or 0.0 for match in matches])
    known = np.array([bool(match.known) for match in matches])
    return Judged(
        places,
        scores,
        correct,
        curve,
        reliability(probability[judged][answered[judged]], correct[judged][answered[judged]]),
        claims(known[judged], correct[judged], on_route),
        certainties=tuple(map(certainty_of, matches)),
        first_known=int(np.argmax(known)) if known.any() else None,
        too_fast=sum(match.too_fast for match in matches),
    )


def judge_smoothed(matches: Sequence[SmoothedMatch], truth: Truth) -> Judged:
    """Compare smoothed matches with the ground truth, in the frames that have one."""
    judged = judge([smoothed.match for smoothed in matches], truth)
    return replace(judged, mean_lag=float(np.mean([smoothed.lag for smoothed in matches])))
