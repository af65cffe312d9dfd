"""Passages between chains, against powers of the transition matrix of one step."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from route_networks import network, networks

from placefield.maps.topology import Topology
from placefield.matching.chains import ONE_CHAIN, chains_of, crossed_to
from placefield.matching.motion import REACH
from placefield.matching.textbook import ways_of

COUNT = 20
Chances = NDArray[np.float64]


def powers(topology: Topology) -> list[list[Chances]]:
    """Of steps of 0 to REACH places from each place to each, on the map and on its reverse."""
    made = []
    for ways in ways_of(topology.graph, topology.count):
        steps: list[Chances] = [np.eye(topology.count)]
        for _ in range(REACH):
            steps.append(steps[-1] @ ways.toarray())
        made.append(steps)
    return made


def test_a_line_is_one_chain() -> None:
    chains = chains_of(network(COUNT).graph, COUNT)
    assert chains.edges is ONE_CHAIN.edges
    assert not len(chains.ahead.source)
    assert not len(chains.behind.source)


def test_chains_end_where_links_begin_and_begin_where_links_end() -> None:
    topology = network(COUNT, [0, 12], [(3, 7), (11, 12), (19, 12)])
    chains = chains_of(topology.graph, COUNT)
    assert chains.edges.tolist() == [0, 4, 7, 12, 20]
    assert chains.of(np.array([0, 3, 4, 11, 12, 19], np.int32)).tolist() == [0, 0, 1, 2, 3, 3]


@given(networks(COUNT))
@settings(max_examples=60, deadline=None)
def test_steps_along_chains_and_passages_are_all_steps(topology: Topology) -> None:
    chains = chains_of(topology.graph, COUNT)
    of = chains.of(np.arange(COUNT, dtype=np.int32))
    for passages, steps, sign in zip(
        (chains.ahead, chains.behind), powers(topology), (1, -1), strict=True
    ):
        for places in range(1, REACH + 1):
            chances = np.zeros((COUNT, COUNT))
            for here in range(COUNT):
                there = here + sign * places
                if 0 <= there < COUNT and of[there] == of[here]:
                    chances[here, there] += 1
                for source, target, shift, chance in zip(*passages, strict=True):
                    there = here + sign * places - int(shift)
                    if of[here] == source and 0 <= there < COUNT and of[there] == target:
                        chances[here, there] += chance
            np.testing.assert_allclose(chances, steps[places], atol=1e-5)


@given(networks(COUNT), st.sets(st.integers(0, COUNT - 1)))
@settings(max_examples=60, deadline=None)
def test_places_that_passages_lead_to_are_found(topology: Topology, some: set[int]) -> None:
    places = np.array(sorted(some), np.int32)
    chains = chains_of(topology.graph, COUNT)
    crossed = set(crossed_to(chains, places).tolist())
    of = chains.of(np.arange(COUNT, dtype=np.int32))
    reached = sum(powers(topology)[0][1:], np.zeros((COUNT, COUNT)))
    for here in some:
        leads = reached[here] > 1e-5
        assert set(np.flatnonzero(leads & (of != of[here])).tolist()) <= crossed
    anywhere = set(np.flatnonzero(reached[places].any(axis=0)).tolist()) if some else set()
    assert crossed <= anywhere
