"""A channel's candidate for one query frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

UNANSWERED = -1
"""Stands for the place where there is no answer."""

TOO_FAST = 0.5
"""Mean posterior of the channels from which on a vehicle is reported as too fast for the map."""


@dataclass(frozen=True)
class Candidate:
    """A channel's answer for one query frame.

    Attributes:
        place: index of the best place, or ``UNANSWERED``.
        score: of that place; 0 where there is no answer. Under ``filter`` its belief, the higher
            the better; under the other rules the lower the better.
        places: (n,) int32, ascending, the places that ``evidence`` is for under ``filter``; else
            empty.
        evidence: float32. Under ``filter`` (n,), the belief in these places; that in all others is
            negligible. Under ``evidence`` (K,), of every place; empty under ``ams``.
        too_fast: posterior, 0 to 1, that the vehicle moves faster than the map resolves; under
            other rules than ``filter`` it is 0.
    """

    place: int
    score: float
    places: NDArray[np.int32]
    evidence: NDArray[np.float32]
    too_fast: float = 0.0

    def reversed(self, count: int) -> "Candidate":
        """Return the same for a map of so many places in reverse order."""
        if self.place == UNANSWERED:
            return self
        last = count - 1
        places, evidence = last - self.places[::-1], self.evidence[::-1].copy()
        return Candidate(last - self.place, self.score, places, evidence, self.too_fast)


NO_PLACES: NDArray[np.int32] = np.empty(0, np.int32)
NO_EVIDENCE: NDArray[np.float32] = np.empty(0, np.float32)
NO_CANDIDATE = Candidate(UNANSWERED, 0.0, NO_PLACES, NO_EVIDENCE)
