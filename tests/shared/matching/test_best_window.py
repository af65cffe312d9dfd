"""The window of highest belief on networks of routes; on lines, see ``test_rules``."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from route_networks import network, networks

from placefield.maps.topology import Topology
from placefield.matching.best_window import best_window, vicinity_of

COUNT = 24


def belief_in(beliefs: dict[int, float]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    ordered = dict(sorted(beliefs.items()))
    return np.array([*ordered], np.int32), np.array([*ordered.values()], np.float32)


def places_near(topology: Topology, place: int, tolerance: int) -> set[int]:
    """Return from where, or to where, at most so many steps of one place lead."""
    near = {place}
    for edges in (
        topology.graph.edges(topology.count),
        topology.graph.edges(topology.count)[:, ::-1],
    ):
        reached = {place}
        for _ in range(tolerance):
            reached = {int(b) for a, b in edges if int(a) in reached}
            near |= reached
    return near


beliefs = st.dictionaries(st.integers(0, COUNT - 1), st.floats(2**-10, 0.125, width=32), min_size=1)


@given(networks(COUNT), beliefs, st.integers(0, 3))
@settings(max_examples=100, deadline=None)
def test_the_belief_is_that_in_all_places_near_the_middle(
    topology: Topology, belief: dict[int, float], tolerance: int
) -> None:
    middle, around = best_window(*belief_in(belief), vicinity_of(topology, tolerance))
    near = places_near(topology, middle, tolerance)
    assert around == pytest.approx(sum(belief[place] for place in near & belief.keys()), abs=1e-6)
    best = max(belief, key=belief.__getitem__)
    assert tolerance > 0 or belief[middle] == belief[best]


@given(st.lists(st.floats(2**-10, 0.125, width=32), min_size=5, max_size=5))
def test_it_does_not_matter_where_a_circuit_was_cut(belief: list[float]) -> None:
    vicinity = vicinity_of(network(COUNT, links=[(COUNT - 1, 0)]), 2)
    middles = [
        best_window(
            *belief_in({(cut + i) % COUNT: each for i, each in enumerate(belief)}), vicinity
        )
        for cut in range(COUNT)
    ]
    away = [(middle - cut) % COUNT for cut, (middle, _) in enumerate(middles)]
    assert max(away) - min(away) <= 1  # the mean may be half way between two places


def test_belief_at_the_seam_of_a_circuit_is_one_window() -> None:
    belief = belief_in({0: 0.3, 1: 0.2, 12: 0.05, COUNT - 2: 0.1, COUNT - 1: 0.3})
    cut = best_window(*belief, vicinity_of(network(COUNT), 2))
    closed = best_window(*belief, vicinity_of(network(COUNT, links=[(COUNT - 1, 0)]), 2))
    assert cut[1] == pytest.approx(0.5)
    assert closed[0] in {0, COUNT - 1}
    assert closed[1] == pytest.approx(0.9)


def test_neighbours_by_number_on_two_routes_are_not_near() -> None:
    belief = belief_in({11: 0.4, 12: 0.5})
    assert best_window(*belief, vicinity_of(network(COUNT, [0, 12]), 3)) == (12, 0.5)
    linked = network(COUNT, [0, 12], [(11, 12)])
    assert best_window(*belief, vicinity_of(linked, 3))[1] == pytest.approx(0.9)


def test_before_a_fork_belief_on_both_ways_is_near() -> None:
    fork = network(COUNT, [0, 8, 16], [(7, 8), (7, 16)])
    belief = belief_in({6: 0.1, 7: 0.5, 8: 0.2, 16: 0.2})
    assert best_window(*belief, vicinity_of(fork, 2)) == (7, pytest.approx(1.0))
