"""An explorer's candidate is the match; without it there is none."""

import math

import pytest

from placefield.config import MatchingConfig
from placefield.fusion.exploration_stage import ExplorationStage
from placefield.fusion.match import Match
from placefield.matching.candidate import UNANSWERED
from placefield.matching.explored_candidate import to_candidate
from placefield.matching.exploring import NEW, Answer

STAGE = ExplorationStage(MatchingConfig(precision=0.9))


def test_a_match_has_all_that_the_explorer_answered() -> None:
    match = STAGE.fuse([to_candidate(Answer(12, 0.75, 0.125, False, 0.0))])
    assert match == Match(12, pytest.approx(math.log(3)), probability=0.75, known=False, new=0.125)
    assert STAGE.fuse([to_candidate(Answer(12, 0.95, 0.0, True))]).known
    assert STAGE.fuse([to_candidate(Answer(12, 0.95, 0.0, False, 0.5))]).too_fast


def test_a_new_place_is_an_answer_with_its_probability() -> None:
    match = STAGE.fuse([to_candidate(NEW)])
    assert (match.place, match.probability, match.known, match.new) == (UNANSWERED, 0.0, False, 1.0)
    assert math.isfinite(match.score)


def test_without_a_candidate_nothing_is_said_of_the_place() -> None:
    assert STAGE.fuse([], [0]) == Match(UNANSWERED, 0.0, (0,))


def test_a_candidate_of_a_shard_does_not_fit() -> None:
    assert STAGE.fits(to_candidate(NEW))
    assert not STAGE.fits(to_candidate(NEW), shards=2)
