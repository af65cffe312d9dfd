from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest

from placefield.bus.messages import FrameMessage
from placefield.errors import FrameError, MessageError
from placefield.maps.map import Map
from placefield.matching.candidate import Candidate
from placefield_tools.dashboard.drawings import (
    FIELD_HEIGHT,
    RouteDrawing,
    firing_drawing,
    match_drawing,
    segments_drawing,
)
from placefield_tools.dashboard.fields import Window
from placefield_tools.dashboard.frame_images import distance_picture, frame_picture
from placefield_tools.dashboard.marks import marks_drawing


def drawn(inside: str) -> list[ET.Element]:
    return list(ET.fromstring(f"<svg>{inside}</svg>"))


def test_every_segment_is_a_bar_the_longer_the_higher(route_map: Map) -> None:
    [channel, *_] = route_map.channels
    bars = drawn(segments_drawing(channel, Window(0, route_map.places.count)))
    spans = [(float(bar.get("x", "")), float(bar.get("width", ""))) for bar in bars]
    assert spans == [(first, end - first) for first, end in channel.segments.tolist()]
    heights = {float(bar.get("width", "")): -float(bar.get("y", "")) for bar in bars}
    assert [heights[scale] for scale in sorted(heights)] == sorted(heights.values())


def test_a_window_cuts_the_bars_at_its_edges(route_map: Map) -> None:
    for bar in drawn(segments_drawing(route_map.channels[0], Window(13, 31))):
        left, width = float(bar.get("x", "")), float(bar.get("width", ""))
        assert left >= 0
        assert width > 0
        assert left + width <= 18


def test_what_fires_is_the_segment_of_the_candidate(route_map: Map) -> None:
    [channel, *_] = route_map.channels
    first, end = channel.segments[1].tolist()
    candidate = Candidate(first, 0.5, np.array([first], np.int32), np.array([0.5], np.float32))
    names = {
        part.get("class"): part
        for part in drawn(firing_drawing(channel, candidate, "filter", Window(0, 60)))
    }
    assert set(names) == {"field", "firing", "evidence", "candidate"}
    field = names["field"]
    assert (field.get("x"), field.get("width")) == (str(first), str(end - first))
    assert names["candidate"].get("d") == f"M{first + 0.5:g} 0V{FIELD_HEIGHT}"


def test_what_is_outside_of_the_window_is_not_drawn(route_map: Map) -> None:
    candidate = Candidate(50, 0.5, np.array([50], np.int32), np.array([0.5], np.float32))
    assert firing_drawing(route_map.channels[0], candidate, "filter", Window(0, 10)) == ""
    assert match_drawing(50, Window(0, 10)) == ""
    assert match_drawing(-1, Window(0, 10)) == ""


def test_verdicts_have_marks_of_different_shapes() -> None:
    marks = drawn(marks_drawing([(0.5, 9, "known"), (1.5, 8, "likely"), (2.5, 7, "unknown")]))
    dot, ring, middle, edge, cross = ((mark.get("class"), mark.get("d", "")) for mark in marks)
    assert dot == ("known", "M0.5 9.00h0")
    assert ring == ("likely under", "M1.5 8.00h0")
    assert middle == ("likely over", ring[1])
    assert cross == ("unknown over", edge[1])
    assert cross[1].startswith("M2.5 7.00m-1.2 -2.4l2.4 4.8")


def test_the_three_verdicts_differ_in_shape_on_the_route() -> None:
    route = RouteDrawing.of(np.zeros((4, 3)), 4)
    shapes = {kind: drawn(route.match(2, [], kind))[-1].tag for kind in ("known", "unknown")}
    assert shapes == {"known": "circle", "unknown": "path"}
    assert 'class="here likely"' in route.match(2, [], "likely")


def test_a_route_keeps_its_shape_with_north_upwards() -> None:
    poses = np.array([[0, 0, 0], [100, 0, 0], [100, 50, np.pi / 2]], np.float64)
    route = RouteDrawing.of(poses, 3)
    corners = drawn(route.inside)[0].get("d", "")[1:].split("L")
    a, b, c = (np.array(corner.split(), np.float64) for corner in corners)
    assert b[0] - a[0] == pytest.approx(2 * (b[1] - c[1]), rel=1e-3)
    assert (b[1], c[0]) == (a[1], b[0])
    assert c[1] < b[1]
    assert route.bar_m == 20
    here = {part.get("class"): part for part in drawn(route.match(2, [0, 1], "known"))}
    assert "rotate(-90.0)" in here["heading known"].get("transform", "")
    assert float(here["here known"].get("cx", "")) == pytest.approx(c[0])


def test_a_route_without_poses_is_a_line() -> None:
    route = RouteDrawing.of(np.empty((0, 3)), 10)
    here = {part.get("class"): part for part in drawn(route.match(9, [], "known"))}
    assert "heading known" not in here
    assert float(here["here known"].get("cx", "")) == 960
    assert route.bar_m == 0


def test_a_route_is_broken_where_nobody_knows_it() -> None:
    poses = np.column_stack([np.arange(8.0), np.zeros(8), np.zeros(8)])
    poses[[0, 4]] = np.nan
    route = RouteDrawing.of(poses, 8)
    assert drawn(route.inside)[0].get("d", "").count("M") == 2
    assert "nan" not in route.inside
    here = route.match(4, [2, 3, 4], "known")
    assert "nan" not in here
    assert drawn(here)[0].get("d", "").count("M") == 2


def test_a_route_of_one_spot_can_be_drawn() -> None:
    route = RouteDrawing.of(np.zeros((4, 3)), 4)
    assert "nan" not in route.inside
    assert "inf" not in route.inside


def test_near_is_dark_and_what_is_not_known_is_white() -> None:
    rows = [None, *(np.abs(np.arange(50, dtype=np.float32) - place) for place in (10, 40))]
    picture = cv2.imdecode(np.frombuffer(distance_picture(rows, 50), np.uint8), 0)
    assert picture.shape == (50, 3)
    assert (picture[:, 0] == 255).all()
    assert picture[:, 1].argmin() == 49 - 10  # places upwards
    assert picture[:, 2].argmin() == 49 - 40


def test_a_frame_is_shown_no_larger_than_need_be() -> None:
    pixels = np.full((1000, 2000, 3), 90, np.uint8)
    for image in (pixels, cv2.imencode(".png", pixels)[1].tobytes(), pixels[..., 0]):
        shown = frame_picture(FrameMessage(image=image).encode())
        assert cv2.imdecode(np.frombuffer(shown, np.uint8), 1).shape == (320, 640, 3)


def test_what_is_no_frame_is_refused() -> None:
    with pytest.raises(MessageError):
        frame_picture(b"garbage")
    with pytest.raises(FrameError):
        frame_picture(FrameMessage(image=b"garbage").encode())
    assert frame_picture(FrameMessage(descriptor=np.ones(4, np.float32)).encode()) is None


def test_a_point_of_the_drawing_has_a_nearest_place() -> None:
    poses = np.array([[0, 0, 0], [np.nan] * 3, [50, 0, 0], [100, 0, 0]], np.float64)
    route = RouteDrawing.of(poses, 4)
    middle = route.width / 2
    assert [route.nearest(x, 0.0) for x in (0.0, middle, route.width)] == [0, 2, 3]


def test_beliefs_are_drawn_at_their_places_the_likelier_the_longer() -> None:
    route = RouteDrawing.of(np.empty((0, 3)), 3)
    places, beliefs = np.array([0, 1, 2], np.int32), np.array([0.5, 0.25, 1e-4])
    [lines] = drawn(route.belief(places, beliefs))
    assert lines.get("d") == "M40.0 100.0v-35.0M500.0 100.0v-17.5"
    assert route.belief(places[2:], beliefs[2:]) == ""
