"""A ground truth that names routes: near places count along routes and links."""

from pathlib import Path

import numpy as np
import pytest

from placefield.errors import TruthError
from placefield.evaluation.truth import Truth, read_truth
from placefield.maps.near_places import places_near
from placefield.maps.route_graph import RouteGraph, place_in

# A has places 0 to 9, B 10 to 19; A's end leads to place 3 of B, and B's end to B's start.
GRAPH = RouteGraph(("A", "B"), np.array([0, 10], np.int32), np.array([[9, 13], [19, 10]], np.int32))


def read(tmp_path: Path, *rows: str) -> Truth:
    path = tmp_path / "truth.csv"
    path.write_text("\n".join(["query,route,place", *rows]))
    return read_truth(
        path, 3, 20, lambda route, at: places_near(GRAPH, 20, place_in(GRAPH, 20, route, at), 2)
    )


def test_near_places_are_right_along_links_and_not_over_the_boundary_of_routes() -> None:
    assert places_near(GRAPH, 20, 8, 2).tolist() == [6, 7, 8, 9, 13]
    assert places_near(GRAPH, 20, 10, 2).tolist() == [10, 11, 12, 18, 19]
    assert places_near(GRAPH, 20, 4, 0).tolist() == [4]


def test_places_are_named_by_route_and_number(tmp_path: Path) -> None:
    truth = read(tmp_path, "0,A,8", "2,B,0")
    assert truth.on_route.tolist() == [True, False, True]
    assert truth.correct(np.array([13, 5, 18])).tolist() == [True, False, True]
    assert truth.correct(np.array([10, 5, 9])).tolist() == [False, False, False]


def test_a_place_of_a_copy_of_the_stretch_is_right_too(tmp_path: Path) -> None:
    same = np.arange(20, dtype=np.int32)
    same[14:17] = [4, 5, 6]
    truth = read(tmp_path, "0,A,5").shared(same)
    assert truth.correct(np.array([15, 0, 0])).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("0,C,1", "truth.csv:2: no route 'C': the routes are A, B"),
        ("0,B,10", "truth.csv:2: B has no place 10, but places 0 to 9"),
        ("0,B,x", "truth.csv:2: place 'x' is not an integer"),
        ("3,B,0", "truth.csv:2: query 3 is not one of the 3 query frames"),
    ],
)
def test_a_row_that_names_no_place_is_refused(tmp_path: Path, row: str, reason: str) -> None:
    with pytest.raises(TruthError, match=reason):
        read(tmp_path, row)


def test_without_a_map_of_routes_the_columns_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("query,route,place\n0,A,1")
    with pytest.raises(TruthError, match=r"no column first, last: .* or query,route,place"):
        read_truth(path, 3, 20)
