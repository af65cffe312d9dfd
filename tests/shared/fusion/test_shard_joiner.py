from dataclasses import replace

import numpy as np

from placefield.fusion.shard_joiner import join_shards
from placefield.matching.candidate import (
    NO_CANDIDATE,
    NO_EVIDENCE,
    NO_PLACES,
    Candidate,
)


def belief_in(values: dict[int, float]) -> Candidate:
    """Belief in some places, ascending."""
    place = max(values, key=lambda place: values[place])
    places, beliefs = np.array([*values], np.int32), np.array([*values.values()], np.float32)
    return Candidate(place, float(beliefs.max()), places, beliefs)


def evidence_of(first: int, values: list[float]) -> Candidate:
    best = int(np.argmin(values))
    return Candidate(first + best, values[best], NO_PLACES, np.array(values, np.float32))


def test_the_beliefs_of_all_shards_are_joined() -> None:
    shards = [belief_in({3: 0.125, 9: 0.25}), belief_in({10: 0.5, 11: 0.0625})]
    joined = join_shards(shards, "filter")
    assert (joined.place, joined.score) == (10, 0.5)
    assert joined.places.tolist() == [3, 9, 10, 11]
    assert joined.evidence.tolist() == [0.125, 0.25, 0.5, 0.0625]
    assert (joined.places.dtype, joined.evidence.dtype) == (np.int32, np.float32)


def test_a_shards_best_place_is_left_out_if_its_belief_is_negligible() -> None:
    joined = join_shards([belief_in({3: 1e-9}), belief_in({10: 0.5}), belief_in({20: 0})], "filter")
    assert joined.places.tolist() == [10]


def test_the_best_place_of_all_is_kept_even_if_its_belief_is_negligible() -> None:
    shards = [belief_in({3: 1e-9}), belief_in({10: 5e-8}), belief_in({20: 2e-8})]
    joined = join_shards(shards, "filter")
    assert joined.place == 10
    assert joined.places.tolist() == [10]


def test_of_places_as_good_the_first_is_the_best() -> None:
    assert join_shards([belief_in({3: 0.25}), belief_in({10: 0.25})], "filter").place == 3
    assert join_shards([evidence_of(0, [2, 1]), evidence_of(2, [1, 3])], "evidence").place == 1


def test_evidence_is_of_every_place_in_turn_and_the_lowest_the_best() -> None:
    joined = join_shards([evidence_of(0, [0.5, -1, 2]), evidence_of(3, [-1.5, 4])], "evidence")
    assert (joined.place, joined.score) == (3, -1.5)
    assert joined.evidence.tolist() == [0.5, -1, 2, -1.5, 4]
    assert len(joined.places) == 0


def test_the_lowest_score_is_the_best() -> None:
    shards = [Candidate(4, 2.5, NO_PLACES, NO_EVIDENCE), Candidate(8, 1.5, NO_PLACES, NO_EVIDENCE)]
    joined = join_shards(shards, "ams")
    assert (joined.place, joined.score) == (8, 1.5)
    assert len(joined.places) == len(joined.evidence) == 0


def test_every_shard_has_the_same_posterior_of_too_fast() -> None:
    shards = [replace(belief_in({3: 0.125}), too_fast=0.75), belief_in({10: 0.0625})]
    shards[1] = replace(shards[1], too_fast=0.75)
    assert join_shards(shards, "filter").too_fast == 0.75


def test_shards_without_a_candidate_have_none_together() -> None:
    assert join_shards([NO_CANDIDATE, NO_CANDIDATE], "filter") is NO_CANDIDATE
