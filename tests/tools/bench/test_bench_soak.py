"""A short soak, through real processes."""

from placefield_tools.bench.figure import as_object
from placefield_tools.bench.soak import HOURS, PLACES, bench_soak


def test_laps_of_a_route_are_answered_alike_from_the_first_hour_to_the_last() -> None:
    found = as_object(bench_soak(frames=HOURS * PLACES))
    assert found["soak_frames"] == HOURS * PLACES
    assert found["soak_other"] == 0
    assert found["soak_partial"] == 0
    assert found["soak_afresh"] == 1
    assert 0 <= found["soak_growth"] < 0.5
