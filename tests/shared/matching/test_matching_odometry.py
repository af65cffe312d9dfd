"""Odometry: displacements of beliefs against simulated vehicles, and late readings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.matching.motion import SPEEDS
from placefield.matching.odometry import (
    Displacement,
    Odometer,
    RouteCells,
    carry,
    carry_back,
    reached_by,
    route_cells,
    speeds_of,
)

VEHICLES = 400_000


def measured(metres: float, deviation: float = 0.0) -> Displacement:
    return Displacement(metres, deviation, metres, is_measured=True)


def route_of(*travelled: float) -> RouteCells:
    made = route_cells(np.array(travelled))
    assert made is not None
    return made


def carried(
    along: RouteCells, displacement: Displacement, place: int, hypothesis: int
) -> NDArray[np.float32]:
    belief = np.zeros((1, 2), np.float32)
    belief[0, hypothesis] = 1
    stayed, came = arrivals(along, displacement, np.array([place], np.int32), belief)[:, hypothesis]
    assert np.count_nonzero(np.delete(stayed, place)) == came[place] == 0
    return np.asarray(stayed + came)


def arrivals(
    along: RouteCells,
    displacement: Displacement,
    places: NDArray[np.int32],
    belief: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the beliefs that stay and that come, on the map and its reverse, (2, 2, K)."""
    arrived = np.zeros((2, 2, len(along.middles)), np.float32)
    carry(places, belief, along, displacement, 0, arrived)
    return arrived


def vehicles_after(
    along: RouteCells, displacement: Displacement, place: int, sign: int
) -> NDArray[np.float64]:
    """Return the fraction of very many vehicles that end at each place after the displacement."""
    rng = np.random.default_rng(1)
    start = rng.uniform(along.edges[place], along.edges[place + 1], VEHICLES)
    deviation = 0.05 * abs(displacement.metres) + 0.02 * along.spacing + displacement.deviation
    noise = np.sqrt(3) * deviation * rng.uniform(-1, 1, VEHICLES)
    half = max(abs(displacement.metres) / 2, np.sqrt(3) * deviation)
    slipped = displacement.metres / 2 + half * rng.uniform(-1, 1, VEHICLES)
    moved = np.where(rng.random(VEHICLES) < 0.02, slipped, displacement.metres + noise)
    ends = np.histogram(start + sign * moved, along.edges)[0]
    return np.asarray(ends / VEHICLES)


ROUTES = [
    route_of(*range(12)),
    route_of(0, 1, 1, 1, 1.2, 4, 4.5, 5, 9, 9, 10, 12),
    route_of(*(0.01 * np.arange(12))),
]


@pytest.mark.parametrize("along", ROUTES)
@pytest.mark.parametrize("pace", [0, 0.25, 1, 2.6, 7, -0.8])
@pytest.mark.parametrize("place", [0, 3, 8, 11])
@pytest.mark.parametrize("deviation", [0, 0.5])
def test_a_displacement_leads_where_simulated_vehicles_end(
    along: RouteCells, pace: float, place: int, deviation: float
) -> None:
    displacement = measured(pace * along.spacing, deviation * along.spacing)
    for hypothesis, sign in enumerate((1, -1)):
        expected = vehicles_after(along, displacement, place, sign)
        np.testing.assert_allclose(
            carried(along, displacement, place, hypothesis), expected, atol=4e-3
        )


def test_a_displacement_of_a_thousand_places_leads_there() -> None:
    along = route_of(*range(2000))
    arrived = carried(along, measured(1000.0), 500, 0)
    assert arrived.sum() == pytest.approx(1, abs=1e-3)
    assert arrived[1400:1600].sum() == pytest.approx(0.98, abs=5e-3)


@given(st.integers(0, 10**6), st.floats(-3, 9))
@settings(max_examples=30, deadline=None)
def test_the_backward_message_is_the_adjoint_of_carrying_beliefs(seed: int, metres: float) -> None:
    """The sum of beliefs times the message is the same before and after a displacement."""
    rng = np.random.default_rng(seed)
    along, displacement = ROUTES[seed % 2], measured(metres)
    belief = rng.random((12, 2)).astype(np.float32)
    message = rng.random((2, 12, 2)).astype(np.float32)
    places = np.arange(12, dtype=np.int32)
    arrived = arrivals(along, displacement, places, belief)
    back = np.empty((12, 2), np.float32)
    carry_back(places, message, along, displacement, places, back)
    both = arrived.transpose(0, 2, 1) * message
    np.testing.assert_allclose(both.sum((0, 1)), (belief * back).sum(0), rtol=1e-4)


@given(st.integers(0, 10**6), st.floats(-3, 9))
@settings(max_examples=30, deadline=None)
def test_places_reached_are_those_where_beliefs_arrive(seed: int, metres: float) -> None:
    rng = np.random.default_rng(seed)
    along, displacement = ROUTES[seed % 2], measured(metres)
    places = np.flatnonzero(rng.random(12) < 0.3).astype(np.int32)
    arrived = arrivals(along, displacement, places, np.ones((len(places), 2), np.float32))
    reached = reached_by(displacement, along, places)
    assert set(np.flatnonzero(arrived[:, 0].sum(0) > 1e-9)) <= set(reached.tolist())
    assert set(reached.tolist()) <= set(range(12))


def test_a_route_without_any_metres_has_no_cells() -> None:
    assert route_cells(np.zeros(3)) is None
    assert route_cells(np.zeros(1)) is None
    assert route_cells(np.zeros(0)) is None


readings = st.lists(st.tuples(st.floats(0, 5), st.booleans()), min_size=1, max_size=60)


@given(readings)
def test_displacements_add_up_to_the_metres_travelled_however_many_readings_are_missing(
    steps: list[tuple[float, bool]],
) -> None:
    odometer, total, missing = Odometer(), 100.0, 0
    known_until, sum_of_displacements = None, 0.0
    for step, is_there in steps:
        total += step
        displacement = odometer.displacement(total if is_there else None)
        missing = 0 if is_there else missing + 1
        if missing > 10:
            known_until = None
        if displacement is not None:
            sum_of_displacements += displacement.metres
        if (is_there and known_until is None) or (is_there and displacement is None):
            known_until, sum_of_displacements = total, 0.0
        elif is_there and known_until is not None:
            assert sum_of_displacements == pytest.approx(total - known_until, abs=1e-9)


def test_frames_without_a_reading_keep_the_pace_and_the_next_reading_corrects_it() -> None:
    odometer = Odometer()
    assert odometer.displacement(10.0) is None
    assert odometer.displacement(12.0) == Displacement(2.0, 0.0, 2.0, is_measured=True)
    assert odometer.displacement(None) == Displacement(2.0, 1.0, 2.0, is_measured=False)
    assert odometer.displacement(None) == Displacement(2.0, 1.0, 2.0, is_measured=False)
    assert odometer.displacement(15.0) == Displacement(-1.0, 0.0, 1.0, is_measured=False)
    assert odometer.displacement(17.0) == Displacement(2.0, 0.0, 2.0, is_measured=True)


def test_no_pace_is_assumed_for_long_or_after_the_odometer_began_anew() -> None:
    odometer = Odometer()
    odometer.displacement(0.0)
    odometer.displacement(1.0)
    assert all(odometer.displacement(None) is not None for _ in range(10))
    assert odometer.displacement(None) is None
    assert odometer.displacement(30.0) is None
    assert odometer.displacement(31.0) is not None
    assert odometer.displacement(2.0) is None
    assert odometer.displacement(None) is None
    assert odometer.displacement(4.0) is None
    assert odometer.displacement(5.0) == Displacement(1.0, 0.0, 1.0, is_measured=True)


@pytest.mark.parametrize("pace", [0, 0.1, 1, 1.1, 3.7, 6])
def test_the_speeds_of_a_pace_have_it_as_their_mean(pace: float) -> None:
    distribution = speeds_of(pace)
    assert distribution.sum() == pytest.approx(1)
    assert distribution.min() >= 0
    assert distribution @ SPEEDS == pytest.approx(pace)


def test_no_pace_of_odometry_is_too_fast() -> None:
    assert speeds_of(1000.0) @ SPEEDS == 6
