"""Where metres lead to, against vehicles that drive them, and what is made of late readings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.matching.motion import SPEEDS
from placefield.matching.odometry import (
    Odometer,
    Road,
    Way,
    carry,
    carry_back,
    reached_by,
    road,
    speeds_of,
)

VEHICLES = 400_000


def told(metres: float, deviation: float = 0.0) -> Way:
    return Way(metres, deviation, metres, is_measured=True)


def road_of(*travelled: float) -> Road:
    made = road(np.array(travelled))
    assert made is not None
    return made


def carried(along: Road, way: Way, place: int, hypothesis: int) -> NDArray[np.float32]:
    belief = np.zeros((1, 2), np.float32)
    belief[0, hypothesis] = 1
    stayed, came = arrivals(along, way, np.array([place], np.int32), belief)[:, hypothesis]
    assert np.count_nonzero(np.delete(stayed, place)) == came[place] == 0
    return np.asarray(stayed + came)


def arrivals(
    along: Road, way: Way, places: NDArray[np.int32], belief: NDArray[np.float32]
) -> NDArray[np.float32]:
    """What stays and what comes, on the map and its reverse, (2, 2, K)."""
    arrived = np.zeros((2, 2, len(along.middles)), np.float32)
    carry(places, belief, along, way, 0, arrived)
    return arrived


def driven(along: Road, way: Way, place: int, sign: int) -> NDArray[np.float64]:
    """How often each place is where one of very many vehicles ends that drive the way."""
    rng = np.random.default_rng(1)
    start = rng.uniform(along.borders[place], along.borders[place + 1], VEHICLES)
    deviation = 0.05 * abs(way.metres) + 0.02 * along.spacing + way.deviation
    noise = np.sqrt(3) * deviation * rng.uniform(-1, 1, VEHICLES)
    half = max(abs(way.metres) / 2, np.sqrt(3) * deviation)
    slipped = way.metres / 2 + half * rng.uniform(-1, 1, VEHICLES)
    moved = np.where(rng.random(VEHICLES) < 0.02, slipped, way.metres + noise)
    ends = np.histogram(start + sign * moved, along.borders)[0]
    return np.asarray(ends / VEHICLES)


ROADS = [
    road_of(*range(12)),
    road_of(0, 1, 1, 1, 1.2, 4, 4.5, 5, 9, 9, 10, 12),
    road_of(*(0.01 * np.arange(12))),
]


@pytest.mark.parametrize("along", ROADS)
@pytest.mark.parametrize("pace", [0, 0.25, 1, 2.6, 7, -0.8])
@pytest.mark.parametrize("place", [0, 3, 8, 11])
@pytest.mark.parametrize("deviation", [0, 0.5])
def test_a_way_leads_where_vehicles_get_that_drive_it(
    along: Road, pace: float, place: int, deviation: float
) -> None:
    way = told(pace * along.spacing, deviation * along.spacing)
    for hypothesis, sign in enumerate((1, -1)):
        expected = driven(along, way, place, sign)
        np.testing.assert_allclose(carried(along, way, place, hypothesis), expected, atol=4e-3)


def test_a_way_of_a_thousand_places_leads_there() -> None:
    along = road_of(*range(2000))
    arrived = carried(along, told(1000.0), 500, 0)
    assert arrived.sum() == pytest.approx(1, abs=1e-3)
    assert arrived[1400:1600].sum() == pytest.approx(0.98, abs=5e-3)


@given(st.integers(0, 10**6), st.floats(-3, 9))
@settings(max_examples=30, deadline=None)
def test_what_follows_is_taken_back_as_beliefs_are_carried_on(seed: int, metres: float) -> None:
    """The sum of beliefs times what follows is the same at both ends of a way."""
    rng = np.random.default_rng(seed)
    along, way = ROADS[seed % 2], told(metres)
    belief = rng.random((12, 2)).astype(np.float32)
    ahead = rng.random((2, 12, 2)).astype(np.float32)
    places = np.arange(12, dtype=np.int32)
    arrived = arrivals(along, way, places, belief)
    back = np.empty((12, 2), np.float32)
    carry_back(places, ahead, along, way, places, back)
    both = arrived.transpose(0, 2, 1) * ahead
    np.testing.assert_allclose(both.sum((0, 1)), (belief * back).sum(0), rtol=1e-4)


@given(st.integers(0, 10**6), st.floats(-3, 9))
@settings(max_examples=30, deadline=None)
def test_places_reached_are_those_where_beliefs_arrive(seed: int, metres: float) -> None:
    rng = np.random.default_rng(seed)
    along, way = ROADS[seed % 2], told(metres)
    places = np.flatnonzero(rng.random(12) < 0.3).astype(np.int32)
    arrived = arrivals(along, way, places, np.ones((len(places), 2), np.float32))
    reached = reached_by(way, along, places)
    assert set(np.flatnonzero(arrived[:, 0].sum(0) > 1e-9)) <= set(reached.tolist())
    assert set(reached.tolist()) <= set(range(12))


def test_who_does_not_get_anywhere_has_no_road() -> None:
    assert road(np.zeros(3)) is None
    assert road(np.zeros(1)) is None
    assert road(np.zeros(0)) is None


readings = st.lists(st.tuples(st.floats(0, 5), st.booleans()), min_size=1, max_size=60)


@given(readings)
def test_ways_add_up_to_what_was_driven_however_many_readings_are_missing(
    steps: list[tuple[float, bool]],
) -> None:
    odometer, total, missing = Odometer(), 100.0, 0
    told_until, sum_of_ways = None, 0.0
    for step, is_there in steps:
        total += step
        way = odometer.way(total if is_there else None)
        missing = 0 if is_there else missing + 1
        if missing > 10:
            told_until = None
        if way is not None:
            sum_of_ways += way.metres
        if (is_there and told_until is None) or (is_there and way is None):
            told_until, sum_of_ways = total, 0.0
        elif is_there and told_until is not None:
            assert sum_of_ways == pytest.approx(total - told_until, abs=1e-9)


def test_the_pace_is_assumed_of_frames_without_a_reading_and_then_put_right() -> None:
    odometer = Odometer()
    assert odometer.way(10.0) is None
    assert odometer.way(12.0) == Way(2.0, 0.0, 2.0, is_measured=True)
    assert odometer.way(None) == Way(2.0, 1.0, 2.0, is_measured=False)
    assert odometer.way(None) == Way(2.0, 1.0, 2.0, is_measured=False)
    assert odometer.way(15.0) == Way(-1.0, 0.0, 1.0, is_measured=False)
    assert odometer.way(17.0) == Way(2.0, 0.0, 2.0, is_measured=True)


def test_nothing_is_assumed_for_long_or_over_a_count_that_began_anew() -> None:
    odometer = Odometer()
    odometer.way(0.0)
    odometer.way(1.0)
    assert all(odometer.way(None) is not None for _ in range(10))
    assert odometer.way(None) is None
    assert odometer.way(30.0) is None
    assert odometer.way(31.0) is not None
    assert odometer.way(2.0) is None
    assert odometer.way(None) is None
    assert odometer.way(4.0) is None
    assert odometer.way(5.0) == Way(1.0, 0.0, 1.0, is_measured=True)


@pytest.mark.parametrize("pace", [0, 0.1, 1, 1.1, 3.7, 6])
def test_the_speeds_of_a_pace_have_it_as_their_mean(pace: float) -> None:
    distribution = speeds_of(pace)
    assert distribution.sum() == pytest.approx(1)
    assert distribution.min() >= 0
    assert distribution @ SPEEDS == pytest.approx(pace)


def test_no_pace_is_too_fast_that_odometry_tells() -> None:
    assert speeds_of(1000.0) @ SPEEDS == 6
