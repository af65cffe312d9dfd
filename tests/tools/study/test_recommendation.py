from dataclasses import replace

import pytest
from test_report import a_method, a_study, judged

from placefield.evaluation.claims import Claims
from placefield.maps.map import Map
from placefield_tools.study.recommendation import uses, verdict


def test_the_best_fair_method_is_named_for_each_need(route_map: Map) -> None:
    late = replace(judged(39), mean_lag=4.0)
    study = a_study(
        route_map,
        methods=(
            a_method("oracle", 40, oracle=True),
            a_method("failed", 0, judged=None, failure="why"),
            a_method("plain", 30),
            a_method("filter", 35, ours=True),
            a_method("filter, lag 20", 39, ours=True, judged=late, lag=20),
        ),
    )
    assert [use.method for use in uses(study)] == ["filter", "filter, lag 20", "filter, lag 20"]
    assert uses(replace(study, methods=study.methods[:2])) == []
    assert verdict(replace(study, methods=study.methods[:2])) == []


@pytest.mark.parametrize(
    ("claims", "words"),
    [
        (Claims(30, 1.0, 0.75), "calls 30 frames known, all rightly."),
        (Claims(30, 0.9, 0.7), "calls 30 frames known, 3 of them wrongly."),
    ],
)
def test_the_last_sentence_says_what_the_known_matches_come_to(
    route_map: Map, claims: Claims, words: str
) -> None:
    method = a_method("filter", 35, ours=True, judged=replace(judged(35), claims=claims))
    last = verdict(a_study(route_map, methods=(method,)))[-1]
    assert last == f"At the precision asked for, filter {words}"
