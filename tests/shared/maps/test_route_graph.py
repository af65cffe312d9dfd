"""The graph of a map's places: which follow each other, also in reverse."""

import numpy as np
import pytest

from placefield.errors import ConfigError
from placefield.maps.map_metrics import identity_metric, steps_along
from placefield.maps.route_graph import RouteGraph, check_rule, line, problem_of


def graph_of(first: list[int], links: list[list[int]]) -> RouteGraph:
    names = tuple(map(str, first))
    return RouteGraph(names, np.array(first, np.int32), np.array(links, np.int32).reshape(-1, 2))


GRAPH = graph_of([0, 4, 7], [[3, 7], [6, 1], [6, 7], [9, 0]])


def test_edges_are_those_along_routes_and_the_links() -> None:
    along = [[0, 1], [1, 2], [2, 3], [4, 5], [5, 6], [7, 8], [8, 9]]
    assert GRAPH.edges(10).tolist() == along + GRAPH.links.tolist()


def test_the_reversed_graph_has_the_edges_of_the_places_in_reverse_order() -> None:
    turned = GRAPH.reversed(10)
    assert problem_of(turned, 10) is None
    assert {(9 - b, 9 - a) for a, b in GRAPH.edges(10).tolist()} == {
        (a, b) for a, b in turned.edges(10).tolist()
    }
    assert turned.names == ("7", "4", "0")
    assert turned.reversed(10).edges(10).tolist() == GRAPH.edges(10).tolist()


def test_the_likeliest_place_before_has_the_fewest_ways_on_or_is_in_the_route() -> None:
    assert GRAPH.before(10).tolist() == [9, 0, 1, 2, -1, 4, 5, 3, 7, 8]


def test_steps_of_a_map_follow_its_links() -> None:
    places = np.random.default_rng(0).normal(size=(10, 8))
    places = (places / np.linalg.norm(places, axis=1, keepdims=True)).astype(np.float32)
    metric = identity_metric(places)
    steps = steps_along(metric.places, metric.unit, GRAPH)

    def apart(one: int, other: int) -> float:
        return float(np.linalg.norm(places[one] - places[other]))

    assert steps[0, 7] == pytest.approx(apart(3, 7), abs=1e-3)
    assert steps[2, 0] == pytest.approx(apart(7, 0), abs=1e-3)
    assert steps[4, 0] == pytest.approx(apart(2, 0), abs=1e-3)
    known = [apart(place, int(GRAPH.before(10)[place])) for place in range(10) if place != 4]
    assert steps[0, 4] == pytest.approx(np.mean(known), abs=1e-3)
    np.testing.assert_array_equal(steps_along(metric.places, metric.unit, line("")), metric.steps)


def test_rules_that_compare_windows_are_refused_on_a_map_that_is_no_line() -> None:
    check_rule("filter", 2)
    check_rule("evidence", 1)
    for rule in ("evidence", "ams"):
        with pytest.raises(ConfigError, match=f"^rule {rule}: .* give --rule filter$"):
            check_rule(rule, 2)  # type: ignore[arg-type]
