import math
from dataclasses import replace
from fractions import Fraction
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.config import MatchingConfig, Rule
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.matching.best_window import Vicinity
from placefield.matching.candidate import (
    NO_CANDIDATE,
    NO_EVIDENCE,
    NO_PLACES,
    UNANSWERED,
    Candidate,
)


def evidence_of(values: list[float]) -> Candidate:
    place = int(np.argmin(values))
    return Candidate(place, values[place], NO_PLACES, np.array(values, np.float32))


def belief_of(values: list[float]) -> Candidate:
    """Belief in all places."""
    return belief_in(dict(enumerate(values)))


def belief_in(values: dict[int, float]) -> Candidate:
    """Belief in some places, ascending."""
    place = max(values, key=lambda place: values[place])
    places, beliefs = np.array([*values], np.int32), np.array([*values.values()], np.float32)
    return Candidate(place, values[place], places, beliefs)


def laps(*lengths: int) -> NDArray[np.int32]:
    """Which place each is the same as, where every lap begins where the first does."""
    return np.concatenate([np.arange(length, dtype=np.int32) for length in lengths])


def fine(place: int, score: float) -> Candidate:
    return Candidate(place, score, NO_PLACES, NO_EVIDENCE)


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

    config = MatchingConfig(rule="evidence", neighbourhood=neighbourhood)
    assert fuse([evidence_of(channel) for channel in evidence], config) == Match(best, margin)


def test_the_mean_of_huge_evidence_is_finite() -> None:
    huge = evidence_of([3e38, -3e38, 3e38])
    match = fuse([huge, huge], MatchingConfig(rule="evidence", neighbourhood=0))
    assert match.place == 1
    assert np.isfinite(match.score)


def test_of_equally_good_places_the_first_is_the_match_and_the_margin_is_0() -> None:
    values = [0.0, -2, 0, 0, -2, -1]
    match = fuse([evidence_of(values)], MatchingConfig(rule="evidence", neighbourhood=1))
    assert match == Match(1, 0.0)
    wide = MatchingConfig(rule="evidence", neighbourhood=3)
    assert fuse([evidence_of(values)], wide) == Match(1, 1.0)


@st.composite
def beliefs(draw: st.DrawFn) -> list[list[float]]:
    """Belief in eighths, so that ties come; of 1, 2 or 4 channels the mean is exact."""
    places = draw(st.integers(1, 12))
    one = st.lists(st.integers(0, 2).map(lambda n: n / 8), min_size=places, max_size=places)
    return [draw(one) for _ in range(draw(st.sampled_from([1, 2, 4])))]


def reference_place(belief: list[float], tolerance: int) -> int:
    """Return the middle, by belief, of the first of the best 2 tolerance + 1 places in a row."""
    best, middle = Fraction(-1), 0
    width = min(2 * tolerance + 1, len(belief))
    for first in range(len(belief) - width + 1):
        total = moment = Fraction(0)
        for place in range(first, first + width):
            total += Fraction(belief[place])
            moment += Fraction(belief[place]) * place
        if total > best:
            best, middle = total, round(moment / total) if total else 0
    return middle


def log_odds(probability: float) -> float:
    kept = min(max(probability, 1e-12), 1 - 1e-12)
    return math.log(kept / (1 - kept))


@given(beliefs(), st.integers(0, 7))
def test_belief_is_averaged_and_the_match_is_the_middle_of_the_likeliest_places(
    channels: list[list[float]], tolerance: int
) -> None:
    """With maps smaller than the window, tolerance 0, and no belief in any place at all."""
    mean = [sum(values) / len(channels) for values in zip(*channels, strict=True)]
    place = reference_place(mean, tolerance)
    within = sum(value for other, value in enumerate(mean) if abs(other - place) <= tolerance)

    config = MatchingConfig(rule="filter", tolerance=tolerance)
    match = fuse([belief_of(channel) for channel in channels], config)
    assert match.place == place
    assert match.score == pytest.approx(log_odds(within), rel=1e-3, abs=1e-9)


@st.composite
def sparse_beliefs(draw: st.DrawFn) -> list[dict[int, float]]:
    """Channels that have beliefs in some places of a larger map, different ones or the same.

    In eighths, so that sums are exact and ties come; of 1, 2 or 4 channels the mean is exact, too.
    What came over the bus may be no probability: it counts as 0 or 1.
    """
    places = draw(st.sampled_from([3, 15, 40]))
    some = st.lists(st.integers(0, places - 1), min_size=1, max_size=12, unique=True).map(sorted)
    eighths = st.sampled_from([0.0, 1 / 8, 1 / 8, 2 / 8, 3 / 8, 1.0, -2.0, 7.5])
    return [
        {place: draw(eighths) for place in draw(some)}
        for _ in range(draw(st.sampled_from([1, 2, 4])))
    ]


@given(sparse_beliefs(), st.integers(0, 20))
@settings(max_examples=500)
def test_belief_in_some_places_is_fused_like_belief_in_all_of_them_that_is_0_in_the_others(
    channels: list[dict[int, float]], tolerance: int
) -> None:
    """The dense one: mean beliefs, summed by a convolution over 2 tolerance + 1 places."""
    mean = np.zeros(40)
    for channel in channels:
        for place, belief in channel.items():
            mean[place] += min(max(belief, 0), 1) / len(channels)
    padded = np.pad(mean, 2 * tolerance)
    windows = np.convolve(padded, np.ones(2 * tolerance + 1), "valid")
    first = int(np.argmax(windows))
    weights = padded[first : first + 2 * tolerance + 1]
    places = first - 2 * tolerance + np.arange(len(weights))
    matched = fuse(
        [belief_in(channel) for channel in channels],
        MatchingConfig(rule="filter", tolerance=tolerance),
    )
    if not mean.any():
        assert matched.place == min(min(channel) for channel in channels)
        assert matched.probability == pytest.approx(0, abs=1e-11)
        return
    middle = round(Fraction(float(weights @ places)) / Fraction(weights.sum()))
    within = mean[max(middle - tolerance, 0) : middle + tolerance + 1].sum()
    assert matched.place == middle
    assert matched.probability == pytest.approx(min(within, 1), abs=1e-9)


def test_places_far_apart_and_at_the_end_of_what_an_index_holds_do_not_overflow() -> None:
    last = 2**31 - 1
    channels = [belief_in({0: 0.25, last - 1: 0.5, last: 0.125}), belief_in({last: 0.75})]
    match = fuse(channels, MatchingConfig(rule="filter", tolerance=1))
    assert match.place == last
    assert match.probability == pytest.approx((0.5 + 0.125 + 0.75) / 2)


def test_of_equally_likely_places_the_first_is_the_match() -> None:
    values = [0.0, 0.25, 0, 0, 0, 0.25, 0]
    for tolerance in (0, 1):
        match = fuse([belief_of(values)], MatchingConfig(rule="filter", tolerance=tolerance))
        assert match.place == 1
        assert match.score == pytest.approx(math.log(1 / 3))


def test_between_two_peaks_the_match_is_where_most_belief_is_around_it() -> None:
    values = [0.0, 0.4, 0, 0, 0, 0.2, 0.2, 0.15, 0]
    at_once = fuse([belief_of(values)], MatchingConfig(rule="filter", tolerance=0))
    assert at_once.place == 1
    within_one = fuse([belief_of(values)], MatchingConfig(rule="filter", tolerance=1))
    assert within_one.place == 6
    assert within_one.score == pytest.approx(math.log(0.55 / 0.45))


@pytest.mark.parametrize(
    ("posteriors", "too_fast"),
    [([0.5], True), ([0.49], False), ([0.75, 0.25], True), ([1.0, 0.0, 0.25], False)],
)
def test_a_match_is_too_fast_where_the_mean_over_channels_says_so(
    posteriors: list[float], too_fast: bool
) -> None:
    channels = [replace(belief_of([0.0, 0.25]), too_fast=posterior) for posterior in posteriors]
    assert fuse([*channels, NO_CANDIDATE], MatchingConfig()).too_fast == too_fast


def test_a_match_that_is_too_fast_is_not_known_however_little_precision_is_asked_for() -> None:
    config = MatchingConfig(precision=0.25)
    channel = belief_of([0.0, 0.375])
    assert fuse([channel], config).known is True
    match = fuse([replace(channel, too_fast=0.625)], config)
    assert (match.known, match.too_fast) == (False, True)
    assert match.probability == fuse([channel], config).probability


finite = st.floats(allow_nan=False, allow_infinity=False, width=32)


@given(
    st.integers(1, 9).flatmap(
        lambda places: st.lists(
            st.lists(finite, min_size=places, max_size=places), min_size=1, max_size=3
        )
    ),
    st.integers(0, 5),
)
def test_belief_that_is_no_probability_does_no_harm(
    channels: list[list[float]], tolerance: int
) -> None:
    config = MatchingConfig(rule="filter", tolerance=tolerance)
    match = fuse([belief_of(channel) for channel in channels], config)
    assert 0 <= match.place < len(channels[0])
    assert abs(match.score) <= log_odds(1) + 1e-3


def test_the_lowest_fine_score_wins_and_of_equal_ones_the_first_channels() -> None:
    config = MatchingConfig(rule="ams")
    assert fuse([fine(3, 0.5), fine(8, 0.25), fine(9, 0.25)], config) == Match(8, -0.25)


@pytest.mark.parametrize(
    ("rule", "answered"),
    [
        ("filter", belief_of([0.1, 0.7, 0.1])),
        ("evidence", evidence_of([0, -2, 1])),
        ("ams", fine(1, 0.5)),
    ],
)
def test_channels_without_a_candidate_do_not_count(rule: Rule, answered: Candidate) -> None:
    config = MatchingConfig(rule=rule, neighbourhood=0)
    assert fuse([NO_CANDIDATE, answered, NO_CANDIDATE], config) == fuse([answered], config)


def test_a_tolerance_far_beyond_the_map_is_one_of_the_whole_map() -> None:
    whole = fuse([belief_of([0.1, 0.2, 0.4])], MatchingConfig(tolerance=10**12))
    assert whole.place == 1
    assert whole.probability == pytest.approx(0.7)


@pytest.mark.parametrize("rule", get_args(Rule))
def test_without_any_candidate_there_is_no_match(rule: Rule) -> None:
    for candidates in ([], [NO_CANDIDATE, NO_CANDIDATE]):
        match = fuse(candidates, MatchingConfig(rule=rule), missing=[2, 0])
        assert match == Match(UNANSWERED, 0.0, (0, 2))


beliefs = st.dictionaries(st.integers(0, 29), st.floats(0, 0.25, width=32), min_size=1)


@given(st.lists(beliefs, min_size=1, max_size=3), st.integers(0, 4))
def test_where_no_place_is_the_same_as_another_matches_are_the_same_to_the_last_bit(
    channels: list[dict[int, float]], tolerance: int
) -> None:
    config = MatchingConfig(tolerance=tolerance)
    candidates = [belief_in(dict(sorted(channel.items()))) for channel in channels]
    assert fuse(candidates, config, Vicinity(tolerance, laps(30))) == fuse(candidates, config)


@given(beliefs, st.integers(0, 4))
def test_belief_is_that_in_all_places_near_the_match_or_the_same_as_one_near_it(
    belief: dict[int, float], tolerance: int
) -> None:
    same = laps(12, 10, 8)
    candidate = belief_in(dict(sorted(belief.items())))
    match = fuse([candidate], MatchingConfig(tolerance=tolerance), Vicinity(tolerance, same))
    near = sum(
        value
        for place, value in belief.items()
        if abs(place - match.place) <= tolerance
        or abs(int(same[place]) - int(same[match.place])) <= tolerance
    )
    assert match.probability == pytest.approx(min(max(near, 1e-12), 1 - 1e-12), abs=1e-5)


def test_two_laps_share_their_belief_and_the_one_of_most_is_the_match() -> None:
    belief = belief_in({3: 0.2, 4: 0.2, 13: 0.1, 14: 0.3, 15: 0.2})
    alone = fuse([belief], MatchingConfig(tolerance=1))
    shared = fuse([belief], MatchingConfig(tolerance=1), Vicinity(1, laps(10, 10)))
    assert (alone.place, shared.place) == (14, 14)
    assert alone.probability == pytest.approx(0.6)
    assert shared.probability == pytest.approx(1, abs=1e-6)
    assert not alone.known
    assert shared.known


def test_two_laps_together_are_likelier_than_a_place_that_is_passed_once() -> None:
    belief = belief_in({2: 0.3, 8: 0.4, 12: 0.3})
    assert fuse([belief], MatchingConfig(tolerance=0), Vicinity(0, laps(10, 5))).place in {2, 12}


def test_belief_is_not_cut_in_two_where_a_second_lap_leaves_the_first() -> None:
    same = laps(10, 20)
    same[15:] = np.arange(15, 30)  # from here on on a road of its own
    belief = belief_in({14: 0.5, 15: 0.5})
    assert fuse([belief], MatchingConfig(tolerance=1), Vicinity(1, same)).probability > 0.999


def test_a_match_in_another_lap_is_not_elsewhere_for_the_margin_of_evidence() -> None:
    evidence = evidence_of([5, -3, 5, 5, 0, 5, -2.5, -2, 5, 5])
    config = MatchingConfig(rule="evidence", neighbourhood=1)
    assert fuse([evidence], config) == Match(1, 0.5)
    assert fuse([evidence], config, Vicinity(1, laps(5, 5))) == Match(1, 3)
