"""Displacements of beliefs along roads, against simulated vehicles and longer roads."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from route_networks import Link, network

from placefield.matching.carrying import carry, carry_back, reached_by
from placefield.matching.odometry import Displacement
from placefield.matching.roads import Roads, RouteCells, roads_of

VEHICLES = 400_000


def measured(metres: float, deviation: float = 0.0) -> Displacement:
    return Displacement(metres, deviation, metres, is_measured=True)


def cells_of(roads: Roads) -> RouteCells:
    assert roads.cells is not None
    return roads.cells


def road_of(*travelled: float, first: Sequence[int] = (0,), links: Sequence[Link] = ()) -> Roads:
    """Places at these metres, on routes that begin with these places."""
    return roads_of(network(len(travelled), first, links, travelled))


def carried(
    along: Roads, displacement: Displacement, place: int, hypothesis: int
) -> NDArray[np.float32]:
    belief = np.zeros((1, 2), np.float32)
    belief[0, hypothesis] = 1
    stayed, came = arrivals(along, displacement, np.array([place], np.int32), belief)[:, hypothesis]
    assert np.count_nonzero(np.delete(stayed, place)) == came[place] == 0
    return np.asarray(stayed + came)


def arrivals(
    along: Roads,
    displacement: Displacement,
    places: NDArray[np.int32],
    belief: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the beliefs that stay and that come, on the map and its reverse, (2, 2, K)."""
    arrived = np.zeros((2, 2, len(cells_of(along).middles)), np.float32)
    carry(places, belief, along, displacement, 0, arrived)
    return arrived


def vehicles_after(
    along: Roads, displacement: Displacement, place: int, sign: int
) -> NDArray[np.float64]:
    """Return the fraction of very many vehicles that end at each place after the displacement."""
    rng = np.random.default_rng(1)
    start = rng.uniform(cells_of(along).edges[place], cells_of(along).edges[place + 1], VEHICLES)
    deviation = (
        0.05 * abs(displacement.metres) + 0.02 * cells_of(along).spacing + displacement.deviation
    )
    noise = np.sqrt(3) * deviation * rng.uniform(-1, 1, VEHICLES)
    half = max(abs(displacement.metres) / 2, np.sqrt(3) * deviation)
    slipped = displacement.metres / 2 + half * rng.uniform(-1, 1, VEHICLES)
    moved = np.where(rng.random(VEHICLES) < 0.02, slipped, displacement.metres + noise)
    ends = np.histogram(start + sign * moved, cells_of(along).edges)[0]
    return np.asarray(ends / VEHICLES)


ROADS = [
    road_of(*range(12)),
    road_of(0, 1, 1, 1, 1.2, 4, 4.5, 5, 9, 9, 10, 12),
    road_of(*(0.01 * np.arange(12))),
]


NETWORKS = [
    road_of(*range(12), links=[(11, 0)]),
    road_of(0, 1, 2, 3, 5, 6, 7, 8, 9, 20, 21, 22, first=(0, 5, 9), links=[(2, 5), (8, 9), (4, 9)]),
    road_of(*range(12), first=(0, 6), links=[(5, 6), (3, 6), (11, 0), (8, 2), (7, 7)]),
]
"""A circuit; a fork and a join of three routes; circuits in a circuit."""


@pytest.mark.parametrize("along", ROADS)
@pytest.mark.parametrize("pace", [0, 0.25, 1, 2.6, 7, -0.8])
@pytest.mark.parametrize("place", [0, 3, 8, 11])
@pytest.mark.parametrize("deviation", [0, 0.5])
def test_a_displacement_leads_where_simulated_vehicles_end(
    along: Roads, pace: float, place: int, deviation: float
) -> None:
    displacement = measured(pace * cells_of(along).spacing, deviation * cells_of(along).spacing)
    for hypothesis, sign in enumerate((1, -1)):
        expected = vehicles_after(along, displacement, place, sign)
        np.testing.assert_allclose(
            carried(along, displacement, place, hypothesis), expected, atol=4e-3
        )


def test_a_displacement_of_a_thousand_places_leads_there() -> None:
    along = road_of(*range(2000))
    arrived = carried(along, measured(1000.0), 500, 0)
    assert arrived.sum() == pytest.approx(1, abs=1e-3)
    assert arrived[1400:1600].sum() == pytest.approx(0.98, abs=5e-3)


@given(st.integers(0, 10**6), st.floats(-3, 9))
@settings(max_examples=30, deadline=None)
def test_the_backward_message_is_the_adjoint_of_carrying_beliefs(seed: int, metres: float) -> None:
    """The sum of beliefs times the message is the same before and after a displacement."""
    rng = np.random.default_rng(seed)
    along, displacement = [*ROADS, *NETWORKS][seed % 6], measured(metres)
    belief = rng.random((12, 2)).astype(np.float32)
    message = rng.random((2, 12, 2)).astype(np.float32)
    places = np.arange(12, dtype=np.int32)
    arrived = arrivals(along, displacement, places, belief)
    back = carry_back(places, message, along, displacement, places)
    both = arrived.transpose(0, 2, 1) * message
    np.testing.assert_allclose(both.sum((0, 1)), (belief * back).sum(0), rtol=1e-4)


@given(st.integers(0, 10**6), st.floats(-3, 9))
@settings(max_examples=30, deadline=None)
def test_places_reached_are_those_where_beliefs_arrive(seed: int, metres: float) -> None:
    rng = np.random.default_rng(seed)
    along, displacement = [*ROADS, *NETWORKS][seed % 6], measured(metres)
    places = np.flatnonzero(rng.random(12) < 0.3).astype(np.int32)
    arrived = arrivals(along, displacement, places, np.ones((len(places), 2), np.float32))
    reached = reached_by(displacement, along, places)
    assert set(np.flatnonzero(arrived[:, 0].sum(0) > 1e-9)) <= set(reached.tolist())
    assert set(reached.tolist()) <= set(range(12))


@pytest.mark.parametrize("metres", [0.4, 3.0, 9.5, 30.0, -0.8])
def test_in_a_circuit_a_displacement_leads_as_far_as_along_laps_in_a_row(metres: float) -> None:
    circuit, laps = road_of(*range(40), links=[(39, 0)]), road_of(*range(120))
    for place in (0, 1, 17, 39):
        for hypothesis in range(2):
            arrived = carried(circuit, measured(metres), place, hypothesis)
            unrolled = carried(laps, measured(metres), 40 + place, hypothesis)
            np.testing.assert_allclose(arrived, unrolled.reshape(3, 40).sum(0), atol=1e-6)


def test_at_a_fork_half_of_the_belief_takes_each_way_and_where_roads_join_all_of_it_goes_on() -> (
    None
):
    """From the first route to the second or the third, both of which lead to the fourth."""
    links = [(9, 10), (9, 20), (19, 30), (29, 30)]
    fork = road_of(*range(60), first=(0, 10, 20, 30), links=links)
    line = carried(road_of(*range(60)), measured(8.0), 6, 0)
    arrived = carried(fork, measured(8.0), 6, 0)
    np.testing.assert_allclose(arrived[:10], line[:10], atol=1e-6)
    np.testing.assert_allclose(arrived[10:20], line[10:20] / 2, atol=1e-6)
    np.testing.assert_allclose(arrived[20:30], line[10:20] / 2, atol=1e-6)
    line = carried(road_of(*range(60)), measured(24.0), 6, 0)
    arrived = carried(fork, measured(24.0), 6, 0)
    np.testing.assert_allclose(arrived[30:], np.append(line[20:50], 0)[:30], atol=1e-6)


def test_between_routes_without_a_link_nothing_is_carried() -> None:
    apart = road_of(*range(10), *range(10, 30), first=(0, 10))
    assert not carried(apart, measured(8.0), 6, 0)[10:].any()
    assert not carried(apart, measured(8.0), 12, 1)[:10].any()


@pytest.mark.parametrize("metres", [1e300, 1e12, -1e12])
def test_a_displacement_that_is_longer_than_all_roads_ends(metres: float) -> None:
    places, belief = np.array([3], np.int32), np.ones((1, 2), np.float32)
    arrived = arrivals(NETWORKS[0], measured(metres), places, belief)
    assert np.isfinite(arrived).all()
    assert arrived.sum() <= 2
