"""Places that are added one by one against a map that has them all."""

import numpy as np
import pytest

from placefield.maps.map_metrics import identity_metric
from placefield.maps.topology import Topology
from placefield.matching.growing_places import GrowingPlaces, compare, lengths_of
from placefield.matching.map_steps import step_lengths_of


@pytest.mark.parametrize("count", [1, 2, 5, 7, 255, 256, 257, 700])
def test_the_first_places_are_those_of_a_map_of_them(count: int) -> None:
    views = np.random.default_rng(0).normal(size=(720, 12)).astype(np.float32)
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    places = GrowingPlaces(12)
    for view in views:
        places.add(view)
    grown, whole = places.first(count), identity_metric(views[:count])
    np.testing.assert_array_equal(grown.places, whole.places)
    np.testing.assert_array_equal(grown.squares, whole.squares)
    np.testing.assert_allclose(grown.steps, whole.steps, rtol=1e-5)
    lengths, expected = (
        lengths_of(grown),
        step_lengths_of(whole, Topology.line(count), reverse=False),
    )
    for one, other in zip(lengths, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5)
    distances = compare(grown, views[719]).distances * grown.unit**2
    np.testing.assert_allclose(distances, 2 - 2 * views[:count] @ views[719], atol=5e-3)
    assert len(distances) == count


def test_the_first_places_stay_as_they_are_when_others_follow() -> None:
    views = np.random.default_rng(0).normal(size=(600, 8)).astype(np.float32)
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    places = GrowingPlaces(8)
    for view in views[:200]:
        places.add(view)
    first = places.first(200)
    steps, vectors = first.steps.copy(), first.places.copy()
    for view in views[200:]:
        places.add(view)
    np.testing.assert_array_equal(first.steps, steps)
    np.testing.assert_array_equal(first.places, vectors)
