import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from placefield.maps.map import Map
from placefield.matching.candidate import NO_PLACES, Candidate
from placefield_tools.dashboard.fields import (
    Window,
    firing_segment,
    heights,
    thinned,
    window_around,
)


@given(st.integers(1, 5000), st.data())
def test_a_window_shows_its_place_and_no_place_that_is_not_there(
    count: int, data: st.DataObject
) -> None:
    place = data.draw(st.integers(0, count - 1))
    window = window_around(place, count)
    assert 0 <= window.first <= place < window.end <= count
    assert window.size == min(count, 400)


def test_a_window_stays_while_the_vehicle_moves_a_little() -> None:
    windows = [window_around(place, 100_000) for place in range(50_000, 50_400)]
    assert len(set(windows)) == 4


def test_of_much_evidence_the_best_is_kept() -> None:
    rng = np.random.default_rng(3)
    evidence = rng.permutation(np.arange(1000, dtype=np.float32))
    best = thinned(Candidate(0, 0.0, NO_PLACES, evidence), "evidence")
    np.testing.assert_array_equal(best.places, np.flatnonzero(evidence < 400))
    np.testing.assert_array_equal(best.evidence, evidence[evidence < 400])

    places = np.arange(5000, 6000, dtype=np.int32)
    best = thinned(Candidate(5000, 1.0, places, evidence, 0.25), "filter")
    np.testing.assert_array_equal(best.places, 5000 + np.flatnonzero(evidence >= 600))
    assert (best.place, best.score, best.too_fast) == (5000, 1.0, 0.25)


def test_beliefs_are_drawn_where_their_places_are() -> None:
    candidate = Candidate(
        5, 0.6, np.array([1, 5, 6, 90], np.int32), np.array([0.1, 0.6, 0.2, 0.9], np.float32)
    )
    found = heights(candidate, "filter", Window(0, 10), 5)
    np.testing.assert_allclose(found, [0.1, 0, 0.6, 0.2, 0])


def test_evidence_is_drawn_from_the_worst_to_the_best() -> None:
    candidate = Candidate(1, -3.0, np.arange(3, dtype=np.int32), np.array([1, -3, -1], np.float32))
    np.testing.assert_allclose(heights(candidate, "evidence", Window(0, 3), 3), [0, 1, 0.5])


def test_the_field_that_fires_is_the_segment_of_the_place(route_map: Map) -> None:
    for channel in route_map.channels:
        for place in range(route_map.places.count):
            holding = [
                (first, end) for first, end in channel.segments.tolist() if first <= place < end
            ]
            assert firing_segment(channel, place) == (holding[0] if holding else None)
        assert firing_segment(channel, route_map.places.count) is None
        assert firing_segment(channel, -1) is None
