"""What the stage refuses, and that it fuses by its rule; what rules do is in ``test_rules``."""

import numpy as np
import pytest

from placefield.config import MatchingConfig, Rule
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.rules import fuse
from placefield.maps.topology import line_of
from placefield.matching.candidate import NO_CANDIDATE, NO_EVIDENCE, NO_PLACES, Candidate

COUNT = 9


def belief_in(places: list[int], best: int | None = None) -> Candidate:
    beliefs = np.linspace(0.1, 0.2, len(places), dtype=np.float32)
    place = best if best is not None else places[-1]
    return Candidate(place, 0.2, np.array(places, np.int32), beliefs)


def evidence_of(count: int) -> Candidate:
    return Candidate(2, -1.0, NO_PLACES, np.linspace(-1, 1, count, dtype=np.float32))


SCORED = Candidate(3, 0.5, NO_PLACES, NO_EVIDENCE)

FITTING: list[tuple[Rule, Candidate]] = [
    ("filter", belief_in([0, 3, COUNT - 1])),
    ("evidence", evidence_of(COUNT)),
    ("ams", SCORED),
]


@pytest.mark.parametrize(("rule", "candidate"), FITTING)
def test_candidates_of_a_rule_and_map_fit_and_are_fused(rule: Rule, candidate: Candidate) -> None:
    matching = MatchingConfig(rule=rule)
    stage = FusionStage(line_of(COUNT), matching)
    assert stage.fits(candidate)
    assert stage.fits(NO_CANDIDATE)
    expected = fuse([candidate, NO_CANDIDATE], matching, missing=[2])
    assert stage.fuse([candidate, NO_CANDIDATE], [2]) == expected


@pytest.mark.parametrize(
    ("rule", "candidate"),
    [
        *[(rule, made) for rule, _ in FITTING for other, made in FITTING if other != rule],
        ("filter", belief_in([0, COUNT], 0)),
        ("filter", belief_in([3, 3])),
        ("filter", belief_in([4, 3])),
        ("filter", belief_in([-1, 3])),
        ("filter", belief_in([0, 1], COUNT)),
        ("evidence", evidence_of(COUNT - 1)),
        ("ams", Candidate(COUNT, 0.5, NO_PLACES, NO_EVIDENCE)),
    ],
)
def test_candidates_of_another_rule_or_map_do_not_fit(rule: Rule, candidate: Candidate) -> None:
    assert not FusionStage(line_of(COUNT), MatchingConfig(rule=rule)).fits(candidate)


def test_a_shard_holds_no_more_than_the_map() -> None:
    stage = FusionStage(line_of(COUNT), MatchingConfig(rule="evidence"))
    assert stage.fits(evidence_of(4), shards=2)
    assert not stage.fits(evidence_of(COUNT + 1), shards=2)


def test_shards_are_joined_and_whole_channels_pass() -> None:
    joiner = FusionStage(line_of(COUNT), MatchingConfig(rule="evidence")).new_joiner()
    assert joiner.add(0, 1, 0, 1, evidence_of(COUNT)) is not None
    assert joiner.add(0, 0, 1, 2, evidence_of(4)) is None
    joined = joiner.add(0, 0, 0, 2, evidence_of(5))
    assert joined is not None
    assert len(joined.evidence) == COUNT
