"""The steps between places, counted along routes and links."""

import numpy as np

from placefield.maps.route_distances import RouteDistances, places_near
from placefield.maps.route_graph import RouteGraph

# A has places 0 to 9, B 10 to 19; A's end leads to place 3 of B, and B's end to B's start.
GRAPH = RouteGraph(("A", "B"), np.array([0, 10], np.int32), np.array([[9, 13], [19, 10]], np.int32))


def test_places_are_near_along_links_and_not_over_the_boundary_of_routes() -> None:
    assert places_near(GRAPH, 20, 8, 2).tolist() == [6, 7, 8, 9, 13]
    assert places_near(GRAPH, 20, 10, 2).tolist() == [10, 11, 12, 18, 19]
    assert places_near(GRAPH, 20, 4, 0).tolist() == [4]


def test_steps_lead_in_the_direction_of_travel_alone() -> None:
    steps = RouteDistances(GRAPH, 20)
    assert steps.from_place(8)[[7, 8, 9, 13, 12]].tolist() == [np.inf, 0, 1, 2, 11]
    assert steps.to_place(13)[[8, 14, 18, 12]].tolist() == [2, 9, 5, 1]
