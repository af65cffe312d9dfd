import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.config import MatchingConfig, Rule
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.matching.candidate import NO_CANDIDATE, NO_EVIDENCE, UNANSWERED, Candidate


def evidence_of(values: list[float]) -> Candidate:
    place = int(np.argmin(values))
    return Candidate(place, values[place], np.array(values, np.float32))


def fine(place: int, score: float) -> Candidate:
    return Candidate(place, score, NO_EVIDENCE)


@st.composite
def channels(draw: st.DrawFn) -> list[list[float]]:
    """Evidence of few values, so that ties come; of 1, 2 or 4 channels the mean is exact."""
    places = draw(st.integers(1, 12))
    one = st.lists(st.integers(-3, 3).map(float), min_size=places, max_size=places)
    return [draw(one) for _ in range(draw(st.sampled_from([1, 2, 4])))]


@given(channels(), st.integers(0, 6))
def test_evidence_is_averaged_and_its_margin_is_to_the_best_place_elsewhere(
    evidence: list[list[float]], neighbourhood: int
) -> None:
    places = range(len(evidence[0]))
    mean = [sum(channel[place] for channel in evidence) / len(evidence) for place in places]
    best = min(places, key=lambda place: mean[place])
    elsewhere = [mean[place] for place in places if abs(place - best) > neighbourhood]
    margin = min(elsewhere) - mean[best] if elsewhere else 0.0

    config = MatchingConfig(neighbourhood=neighbourhood)
    assert fuse([evidence_of(channel) for channel in evidence], config) == Match(best, margin)


def test_the_mean_of_huge_evidence_is_finite() -> None:
    huge = evidence_of([3e38, -3e38, 3e38])
    match = fuse([huge, huge], MatchingConfig(neighbourhood=0))
    assert match.place == 1
    assert np.isfinite(match.score)


def test_of_equally_good_places_the_first_is_taken_and_the_other_takes_the_margin() -> None:
    values = [0.0, -2, 0, 0, -2, -1]
    match = fuse([evidence_of(values)], MatchingConfig(neighbourhood=1))
    assert match == Match(1, 0.0)
    assert fuse([evidence_of(values)], MatchingConfig(neighbourhood=3)) == Match(1, 1.0)


def test_the_lowest_fine_score_wins_and_of_equal_ones_the_first_channels() -> None:
    config = MatchingConfig(rule="lowest-score")
    assert fuse([fine(3, 0.5), fine(8, 0.25), fine(9, 0.25)], config) == Match(8, -0.25)


@pytest.mark.parametrize(
    ("rule", "answered"), [("evidence", evidence_of([0, -2, 1])), ("lowest-score", fine(1, 0.5))]
)
def test_channels_without_a_candidate_have_no_say(rule: Rule, answered: Candidate) -> None:
    config = MatchingConfig(rule=rule, neighbourhood=0)
    assert fuse([NO_CANDIDATE, answered, NO_CANDIDATE], config) == fuse([answered], config)


@pytest.mark.parametrize("rule", ["evidence", "lowest-score"])
def test_without_any_candidate_there_is_no_match(rule: Rule) -> None:
    for candidates in ([], [NO_CANDIDATE, NO_CANDIDATE]):
        match = fuse(candidates, MatchingConfig(rule=rule), missing=[2, 0])
        assert match == Match(UNANSWERED, 0.0, (0, 2))
