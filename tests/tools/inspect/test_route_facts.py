"""What inspect says about routes, shared stretches and links."""

from dataclasses import replace

import numpy as np
import pytest

from placefield.maps.map import Map
from placefield.maps.route_graph import RouteGraph
from placefield_tools.inspect.route_facts import route_lines, unlinked, warn_of_unlinked


def with_routes(route_map: Map, links: list[tuple[int, int]]) -> Map:
    same = np.arange(60, dtype=np.int32)
    same[30:35] = range(20, 25)
    graph = RouteGraph(("north", "south"), np.array([0, 30], np.int32), np.array(links, np.int32))
    places = replace(route_map.places, same=same)
    return replace(route_map, graph=graph, places=places)


def test_routes_stretches_and_links_are_said_in_numbers_of_their_routes(route_map: Map) -> None:
    assert list(route_lines(with_routes(route_map, [(19, 30), (24, 35)]))) == [
        "route north: 30 places",
        "route south: 30 places",
        "south, place 0 to 4: the same stretch as north, place 20 to 24",
        "link: from north, place 19, to south, place 0",
        "link: from north, place 24, to south, place 5",
    ]


def test_routes_that_are_the_same_from_start_to_end_are_told_so_and_not_that_they_share_nothing(
    route_map: Map, caplog: pytest.LogCaptureFixture
) -> None:
    network = with_routes(route_map, [(29, 0)])
    same = np.tile(np.arange(30, dtype=np.int32), 2)
    warn_of_unlinked(replace(network, places=replace(network.places, same=same)))
    assert [record.getMessage() for record in caplog.records] == [
        f"{one}: is the same stretch as {other} from start to end, so no link joins them; build "
        "both as traverses of one route, without --routes"
        for one, other in (("north", "south"), ("south", "north"))
    ]


def test_nothing_is_said_of_a_mere_line(route_map: Map) -> None:
    assert list(route_lines(route_map)) == []


def test_a_link_within_a_route_joins_it_to_no_other(route_map: Map) -> None:
    assert unlinked(with_routes(route_map, [(29, 0)]).graph) == ["north", "south"]
    assert unlinked(with_routes(route_map, [(29, 30)]).graph) == []
