"""The cells of places along the routes of a map."""

import numpy as np

from placefield.matching.roads import route_cells


def test_a_route_without_any_metres_has_no_cells() -> None:
    assert route_cells(np.zeros(3)) is None
    assert route_cells(np.zeros(1)) is None
    assert route_cells(np.zeros(0)) is None


def test_the_gap_between_two_routes_is_no_cell() -> None:
    first = np.array([0, 3], np.int32)
    cells = route_cells(np.array([0.0, 1, 3, 500, 501, 503]), first)
    assert cells is not None
    assert cells.spacing == 1.5
    np.testing.assert_allclose(np.diff(cells.edges), [1.25, 1.5, 1.75, 1.25, 1.5, 1.75])
