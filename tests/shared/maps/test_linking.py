"""Overlaps give links, so that each copy of a stretch is entered and left by every way."""

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.maps.linking import linked, overlaps, same_by_poses
from placefield.maps.route_graph import NO_LINKS, RouteGraph

NO_POSES = np.empty((0, 3))


def graph_of(*counts: int) -> RouteGraph:
    first = np.cumsum([0, *counts[:-1]]).astype(np.int32)
    return RouteGraph(tuple("ABC"[: len(counts)]), first, NO_LINKS)


def same_as(count: int, twins: dict[int, int]) -> NDArray[np.int32]:
    same = np.arange(count, dtype=np.int32)
    for place, twin in twins.items():
        same[place] = twin
    return same


def straight(start: float, count: int, spacing: float = 1.0, yaw: float = 0.0) -> np.ndarray:
    """Poses on the x axis, in this heading."""
    return np.column_stack(
        [start + spacing * np.arange(count), np.zeros(count), np.full(count, yaw)]
    )


def test_both_copies_of_a_shared_stretch_are_entered_and_left_by_both_routes() -> None:
    # Places 3 to 5 of A (of 8) are shown again by places 2 to 4 of B (of 7).
    same = same_as(15, {10: 3, 11: 4, 12: 5})
    graph = linked(graph_of(8, 7), same, NO_POSES)
    assert [tuple(overlap) for overlap in overlaps(same, graph.first)] == [(10, 12, 3, 5)]
    assert graph.links.tolist() == [[2, 10], [5, 13], [9, 3], [12, 6]]


def test_of_a_branch_that_begins_within_a_route_no_link_leads_from_outside_of_a_route() -> None:
    same = same_as(12, {8: 5, 9: 6, 10: 7})  # B begins as A ends
    assert linked(graph_of(8, 4), same, NO_POSES).links.tolist() == [[4, 8], [7, 11]]


def test_a_stretch_that_was_driven_at_half_the_speed_is_one_overlap() -> None:
    same = same_as(20, {12: 3, 13: 3, 14: 4, 15: 4, 16: 5, 17: 6})
    graph = linked(graph_of(10, 10), same, NO_POSES)
    assert graph.links.tolist() == [[2, 12], [6, 18], [11, 3], [17, 7]]


def test_the_end_of_a_circuit_links_to_its_start_and_goes_on_in_the_first_lap() -> None:
    same = same_as(50, {place: place - 45 for place in range(45, 50)})
    graph = linked(graph_of(50), same, NO_POSES)
    assert graph.links.tolist() == [[44, 0], [49, 5]]


def test_a_route_without_overlaps_stays_a_line() -> None:
    assert linked(graph_of(30), same_as(30, {}), straight(0, 30)).is_line


def test_links_that_are_given_stay() -> None:
    graph = graph_of(8, 4)
    given = RouteGraph(graph.names, graph.first, np.array([[7, 8]], np.int32))
    assert linked(given, same_as(12, {}), NO_POSES).links.tolist() == [[7, 8]]


def test_places_within_five_metres_in_one_heading_are_the_same() -> None:
    poses = np.concatenate([straight(0, 100), straight(60.4, 100, yaw=0.2)])
    same = same_by_poses(same_as(200, {}), poses, graph_of(100, 100).first)
    # One place ahead of A's end is still beside it; those further ahead are not.
    np.testing.assert_array_equal(same[100:140], range(60, 100))
    np.testing.assert_array_equal(same[141:], range(141, 200))


@pytest.mark.parametrize("turn", [np.pi, np.pi / 2], ids=["against", "across"])
def test_a_road_that_is_driven_the_other_way_or_crossed_is_another(turn: float) -> None:
    poses = np.concatenate([straight(0, 50), straight(0, 50, yaw=turn)])
    same = same_as(100, {})
    first = graph_of(50, 50).first
    np.testing.assert_array_equal(same_by_poses(same, poses, first), same)
    assert not len(linked(graph_of(50, 50), same, poses).links)


def test_what_the_pictures_say_counts_more_than_poses() -> None:
    poses = np.concatenate([straight(0, 50), straight(0, 50)])
    same = same_by_poses(same_as(100, {60: 13}), poses, graph_of(50, 50).first)
    assert same[[59, 60, 61]].tolist() == [9, 13, 11]


def test_an_end_links_to_the_place_ahead_of_it_by_poses() -> None:
    # A goes on in B after a gap of one and a half spacings; B's end has nothing ahead.
    poses = np.concatenate([straight(0, 50, 10), straight(505, 50, 10)])
    graph = linked(graph_of(50, 50), same_as(100, {}), poses)
    assert graph.links.tolist() == [[49, 50]]


def test_a_circuit_closes_by_poses() -> None:
    angles = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    circle = np.column_stack(
        [100 * np.cos(angles), 100 * np.sin(angles), np.angle(1j * np.exp(1j * angles))]
    )
    assert linked(graph_of(100), same_as(100, {}), circle).links.tolist() == [[99, 0]]
    assert linked(graph_of(90), same_as(90, {}), circle[:90]).is_line
