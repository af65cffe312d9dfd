"""Odometry: displacements from readings, some of which are late."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.matching.motion import SPEEDS
from placefield.matching.odometry import Displacement, Odometer, speeds_of

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
