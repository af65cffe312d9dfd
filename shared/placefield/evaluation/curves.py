"""Precision and recall over all thresholds on the score."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionRecall:
    """Precision and recall at every threshold, from the strictest to the most lenient.

    Point t keeps the answers whose score is at least `thresholds[t]`. Precision is the fraction of
    the kept answers that are correct. Recall is the number of correct answers among them over the
    number of query frames on the route, kept or not. The first point keeps nothing: threshold
    infinity, precision 1, recall 0.

    Two conventions of recall are in use. The attributes are over the route: a missed place costs
    recall. The properties `…_of_correct` are over the correct matches.

    Attributes:
        thresholds: (T + 1,) float64, descending, one for each of the T distinct scores.
        precision: (T + 1,) float64.
        recall: (T + 1,) float64, never descending.
        auc: area under precision over recall by trapezoids, at most the highest recall.
        recall_at_100_precision: the highest recall at precision exactly 1, or 0.
        recall_at_1: correct answers over query frames on the route, the highest recall.
        queries: number of query frames.
        on_route: number of query frames on the route, the denominator of recall.
    """

    thresholds: NDArray[np.float64]
    precision: NDArray[np.float64]
    recall: NDArray[np.float64]
    auc: float
    recall_at_100_precision: float
    recall_at_1: float
    queries: int
    on_route: int

    @property
    def auc_of_correct(self) -> float:
        """The AUC with recall over the correct matches, as VPR-Bench and scikit-learn compute it.

        Recall then always reaches 1. So this only ranks the answers, and does not fall with missed
        places. It must not be compared with `auc`, whose recall is over the route.
        """
        return self.auc / self.recall_at_1 if self.recall_at_1 else 0.0

    @property
    def recall_at_100_precision_of_correct(self) -> float:
        """The highest recall over the correct matches at precision exactly 1, or 0.

        It is the fraction of the correct matches that score above every wrong one. It must not be
        compared with `recall_at_100_precision`, whose recall is over the route.
        """
        return self.recall_at_100_precision / self.recall_at_1 if self.recall_at_1 else 0.0


def precision_recall(
    correct: NDArray[np.bool_],
    answered: NDArray[np.bool_],
    on_route: NDArray[np.bool_],
    score: NDArray[np.floating],
) -> PrecisionRecall:
    """Sweep the threshold exactly over all distinct scores; equal scores enter together.

    An answer to a query frame off the route is a false positive. An unanswered query frame is never
    kept, whatever its score. If no query frame is on the route, recall and all figures are 0.

    Args:
        correct: whether the query frame's match is right, (Q,) bool.
        answered: whether the query frame has a match, (Q,) bool.
        on_route: whether the query frame has a right place, (Q,) bool.
        score: higher is more confident, (Q,) float.

    Raises:
        ValueError: the shapes differ, a match off the route is called correct, or the score of an
            answered query frame is NaN, which has no rank.
    """
    if not correct.shape == answered.shape == on_route.shape == score.shape == (len(score),):
        raise ValueError("correct, answered, on_route and score must have one and the same length")
    if np.any(correct & ~on_route):
        raise ValueError("a match off the route cannot be correct")
    if np.any(np.isnan(score[answered])):
        raise ValueError("the score of an answered query frame is NaN")

    distinct, rank = np.unique(score[answered].astype(np.float64), return_inverse=True)
    kept = _descending_total(rank, np.ones(len(rank)))
    kept_correct = _descending_total(rank, correct[answered].astype(np.float64))
    frames_on_route = int(np.count_nonzero(on_route))

    thresholds = np.concatenate([[np.inf], distinct[::-1]])
    precision = np.concatenate([[1.0], kept_correct / kept])
    recall = np.concatenate([[0.0], kept_correct / max(frames_on_route, 1)])
    return PrecisionRecall(
        thresholds=thresholds,
        precision=precision,
        recall=recall,
        auc=float(np.trapezoid(precision, recall)),
        recall_at_100_precision=float(recall[precision == 1.0].max()),
        recall_at_1=float(recall[-1]),
        queries=len(score),
        on_route=frames_on_route,
    )


def _descending_total(rank: NDArray[np.intp], amount: NDArray[np.float64]) -> NDArray[np.float64]:
    """Total `amount` over all entries of this rank or higher, for each rank from the highest."""
    total: NDArray[np.float64] = np.cumsum(np.bincount(rank, weights=amount)[::-1])
    return total
