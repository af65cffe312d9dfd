from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.matching.distances import GRID, PlaceDistances, on_grid


def test_distances_are_those_of_the_equation_on_the_grid() -> None:
    rng = np.random.default_rng(0)
    projection = rng.normal(size=(6, 9)).astype(np.float32)
    places = rng.normal(scale=0.1, size=(25, 9)).astype(np.float32)
    query = rng.normal(scale=0.1, size=9).astype(np.float32)
    distances = PlaceDistances(projection, places @ projection.T)
    metric = projection.astype(np.float64).T @ projection
    expected = [(query - place) @ metric @ (query - place) for place in places.astype(np.float64)]
    row = distances.to(distances.project(query))
    assert distances.count == 25
    assert row.dtype == np.float32
    np.testing.assert_allclose(row, expected, atol=2e-6)
    assert np.all(row % GRID == 0)


def test_a_place_is_at_no_distance_of_itself() -> None:
    places = 100 * np.random.default_rng(1).normal(size=(40, 9)).astype(np.float32)
    distances = PlaceDistances(np.eye(9, dtype=np.float32), places)
    for place in range(40):
        row = distances.to(places[place])
        assert row.min() >= 0
        assert row[place] == pytest.approx(0, abs=0.1)  # of squares of 10^5, in float32


@given(st.lists(st.floats(0, 1000, width=32), min_size=2, max_size=300), st.randoms())
def test_sums_of_distances_do_not_depend_on_their_order(
    values: list[float], random: Random
) -> None:
    distances = on_grid(np.array(values, np.float32)).tolist()
    assert all(distance % GRID == 0 for distance in distances)
    total = sum(distances)
    random.shuffle(distances)
    assert sum(distances) == total
