"""The answer of an explorer as the candidate of a channel, and back, to the bit.

The only place of the evidence is ``UNANSWERED``, which stands for a new place.
"""

import numpy as np

from placefield.config import MatchingConfig
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield.matching.exploring import Answer, is_loop

_NEW_PLACE = np.array([UNANSWERED], np.int32)


def to_candidate(answer: Answer) -> Candidate:
    """Return the candidate of an answer: the score is its probability, the evidence is ``new``."""
    new = np.array([answer.new], np.float32)
    return Candidate(answer.place, answer.probability, _NEW_PLACE, new, answer.too_fast)


def to_answer(candidate: Candidate, config: MatchingConfig) -> Answer:
    """Return the answer of a candidate that fits, see ``fits``."""
    place, probability, too_fast = candidate.place, candidate.score, candidate.too_fast
    known = place != UNANSWERED and is_loop(probability, too_fast, config)
    return Answer(place, probability, float(candidate.evidence[0]), known, too_fast)


def fits(candidate: Candidate) -> bool:
    """Whether a candidate from another process may be of an explorer."""
    if not np.array_equal(candidate.places, _NEW_PLACE) or len(candidate.evidence) != 1:
        return False
    return 0 <= candidate.score <= 1 and 0 <= candidate.evidence[0] <= 1
