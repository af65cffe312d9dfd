"""What a channel says of one query frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNANSWERED = -1
"""Stands for the place where there is no answer."""


@dataclass(frozen=True)
class Candidate:
    """A channel's answer for one query frame.

    Attributes:
        place: index of the best place, or ``UNANSWERED``.
        score: of that place; 0 where there is no answer. Under ``filter`` its belief, the higher
            the better; under the other rules the lower the better.
        evidence: (K,) float32, of every place: the belief under ``filter``, the evidence under
            ``evidence``; empty under ``lowest-score``.
    """

    place: int
    score: float
    evidence: NDArray[np.float32]


NO_EVIDENCE: NDArray[np.float32] = np.empty(0, np.float32)
NO_CANDIDATE = Candidate(UNANSWERED, 0.0, NO_EVIDENCE)
