"""The verification of a drive's matches, on a map that learned its inliers and on an older one."""

from dataclasses import replace

import numpy as np
import pytest

from placefield.config import Config
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.verification.place_features import NO_PAIRS, NO_RATIOS, PlaceFeatures
from placefield.verification.verification_stage import Verification, VerificationStage

MOST = 200
MATCH = Match(5, 2.0, probability=0.9)


def stage_on(route_map: Map, **learned: object) -> VerificationStage:
    count = route_map.places.count
    places = PlaceFeatures(
        np.zeros((MOST * count, 2), np.float32),
        np.zeros((MOST * count, 128), np.uint8),
        MOST * np.arange(1, count + 1),
        NO_RATIOS,
        NO_PAIRS,
    )
    of_map = replace(route_map, local_features=replace(places, **learned))
    return VerificationStage(of_map, Config())


def along(stage: VerificationStage, inliers: list[int | None]) -> list[Verification]:
    verified: list[Verification] = []
    for count in inliers:
        verified.append(stage.verify(MATCH, count, verified[-1].posterior if verified else None))
    return verified


def test_inliers_raise_the_probability_or_lower_it_without_silencing_the_match(
    route_map: Map,
) -> None:
    stage = stage_on(route_map, by_chance=np.arange(8, 12).repeat(30))
    verified = along(stage, [80] * 20 + [0] * 10)
    right, wrong = verified[19], verified[-1]
    assert right.match.probability is not None
    assert right.match.probability > 0.999
    assert right.match.known
    assert wrong.match.probability is not None
    assert wrong.ratio is not None
    assert 0 < wrong.match.probability < 0.5
    assert (wrong.match.place, wrong.match.known) == (MATCH.place, False)
    odds = 9 * wrong.ratio
    assert wrong.match.probability == pytest.approx(odds / (1 + odds))
    assert wrong.match.score == pytest.approx(2 + np.log(wrong.ratio))


def test_a_match_without_inliers_stays_and_the_drive_remembers_those_before(
    route_map: Map,
) -> None:
    stage = stage_on(route_map, by_chance=np.arange(8, 12).repeat(30))
    verified = along(stage, [80] * 20 + [None] * 3 + [0])
    assert [each.match for each in verified[20:23]] == [MATCH] * 3
    assert [each.ratio for each in verified[20:23]] == [None] * 3
    later = stage.verify(MATCH, 0, verified[19].posterior, 4)
    assert later.ratio == pytest.approx(verified[-1].ratio)
    assert later.ratio != pytest.approx(along(stage, [0])[0].ratio)


def test_on_a_map_of_an_earlier_version_each_frame_counts_alone(route_map: Map) -> None:
    stage = stage_on(route_map, ratios=np.array([0.5, 3.0]))
    verified = along(stage, [9, 0, None, 1])
    assert [each.ratio for each in verified] == [3, 0.5, None, 3]
    assert all(each.posterior is None for each in verified)
