"""Degrees and metres."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.errors import MapError
from placefield.maps.geography import Origin


def test_a_degree_north_of_zurich_has_the_length_that_tables_give() -> None:
    x, y = Origin(47.0, 8.5).to_local(47.01, 8.5)
    assert x == pytest.approx(0, abs=1e-6)
    assert y == pytest.approx(1111.7, abs=0.2)  # 111.17 km a degree at this latitude


def test_east_is_x_and_shrinks_with_the_latitude() -> None:
    x, y = Origin(60.0, 25.0).to_local(60.0, 25.01)
    assert x == pytest.approx(558.0, abs=0.2)  # 55.80 km a degree at 60°
    assert abs(y) < 0.1


@given(st.floats(-80, 80), st.floats(-179, 179), st.floats(-5000, 5000), st.floats(-5000, 5000))
def test_there_and_back_is_the_same_point_to_a_centimetre(
    latitude: float, longitude: float, x: float, y: float
) -> None:
    origin = Origin(latitude, longitude)
    assert origin.to_local(*origin.to_degrees(x, y)) == pytest.approx((x, y), abs=0.01)


def test_a_frame_says_where_it_is() -> None:
    origin = Origin(-33.123456789, 151.0)
    assert Origin.of_frame(origin.frame) == origin
    assert Origin.of_frame("route") is None
    assert Origin.of_frame(None) is None


@pytest.mark.parametrize("frame", ["wgs84 ", "wgs84 91.0 0.0", "wgs84 1.0", "wgs84 1.0 181.0"])
def test_a_place_that_is_nowhere_is_refused(frame: str) -> None:
    with pytest.raises(MapError, match="LATITUDE LONGITUDE"):
        Origin.of_frame(frame)
