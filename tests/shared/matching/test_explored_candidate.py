"""What an explorer answers comes through a candidate to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from placefield.config import MatchingConfig
from placefield.matching.candidate import NO_CANDIDATE, Candidate
from placefield.matching.explored_candidate import fits, to_answer, to_candidate
from placefield.matching.exploring import NEW, Answer

CONFIG = MatchingConfig()
NEWNESS = float(np.float32(0.1))


@pytest.mark.parametrize(
    "answer",
    [
        NEW,
        Answer(7, 0.1234567890123, NEWNESS, False, 0.25),
        Answer(7, 0.9999, NEWNESS, True, 0.25),
        Answer(7, 0.9999, NEWNESS, False, 0.75),
    ],
)
def test_an_answer_comes_back_as_it_was(answer: Answer) -> None:
    candidate = to_candidate(answer)
    assert fits(candidate)
    assert to_answer(candidate, CONFIG) == answer


@pytest.mark.parametrize(
    "candidate",
    [
        NO_CANDIDATE,
        Candidate(3, 0.5, np.array([3], np.int32), np.array([0.5], np.float32)),
        replace(to_candidate(NEW), evidence=np.array([1.5], np.float32)),
        replace(to_candidate(NEW), evidence=np.array([0.5, 0.5], np.float32)),
        replace(to_candidate(NEW), score=2.0),
    ],
)
def test_a_candidate_of_a_map_does_not_fit(candidate: Candidate) -> None:
    assert not fits(candidate)
