"""Traverses of several routes become one traverse in one coordinate frame."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from placefield.config import Config
from placefield.errors import MapError
from placefield.maps.build import build_map
from placefield.maps.geography import Origin
from placefield.maps.joining_routes import join_routes
from placefield.maps.traverse import Traverse
from placefield.verification.local_features import LocalFeatures

Make = Callable[..., Traverse]


def test_routes_stand_side_by_side_with_metres_that_go_on(make_traverse: Make) -> None:
    one, other = make_traverse(30, name="A", spacing=2), make_traverse(20, name="B", spacing=2)
    network = join_routes([one, other], [("A", 29, "B", 5)], same_frame=True)
    assert network.routes.names == ("A", "B")
    assert network.routes.first.tolist() == [0, 30]
    assert network.routes.links.tolist() == [[29, 35]]
    assert network.thumbnails[30] == other.thumbnails[0]
    np.testing.assert_allclose(network.travelled, 2 * np.arange(50))
    np.testing.assert_array_equal(network.poses[30:], other.poses)


def test_networks_are_joined_with_the_links_that_they_have(make_traverse: Make) -> None:
    parts = [make_traverse(30, name=name) for name in "ABCD"]
    pair = [join_routes(parts[at : at + 2], [("ABCD"[at], 29, "ABCD"[at + 1], 0)]) for at in (0, 2)]
    network = join_routes(pair)
    assert network.routes.names == ("A", "B", "C", "D")
    assert network.routes.first.tolist() == [0, 30, 60, 90]
    assert network.routes.links.tolist() == [[29, 30], [89, 90]]


def test_routes_of_one_name_are_told_apart_by_a_number(make_traverse: Make) -> None:
    routes = [make_traverse(30, name=name) for name in ("day/A", "night/A/", "B", "A")]
    assert join_routes(routes).routes.names == ("A", "A 2", "B", "A 3")


def test_georeferenced_poses_are_converted_to_the_frame_of_the_first(make_traverse: Make) -> None:
    here, there = Origin(-27.5, 153.0), Origin(-27.49, 153.01)
    one = replace(make_traverse(30, name="A", spacing=1), pose_frame=here.frame)
    other = replace(make_traverse(20, name="B", spacing=1), pose_frame=there.frame)
    network = join_routes([one, other])
    assert network.pose_frame == here.frame
    assert here.to_degrees(*network.poses[30, :2]) == pytest.approx((-27.49, 153.01), abs=1e-9)


def test_poses_of_unknown_frames_are_left_out_and_that_is_said(
    make_traverse: Make, caplog: pytest.LogCaptureFixture
) -> None:
    routes = [make_traverse(30, name=name, spacing=1) for name in "AB"]
    assert not len(join_routes(routes).poses)
    assert "give --same-frame" in caplog.text


def test_a_route_without_poses_has_none_among_others(make_traverse: Make) -> None:
    network = join_routes([make_traverse(30, name="A", spacing=1), make_traverse(20, name="B")])
    assert np.isfinite(network.poses[:30]).all()
    assert np.isnan(network.poses[30:]).all()
    assert not len(network.travelled)


@pytest.mark.parametrize(
    ("link", "reason"),
    [
        (("A", 30, "B", 0), "link A:30,B:0: A has no place 30, but places 0 to 29"),
        (("A", 3, "C", 0), "no route 'C': the routes are A, B"),
        (("A", 3, "A", 4), "link A:3,A:4: is the next place already"),
    ],
)
def test_a_link_from_or_to_no_place_is_refused(
    make_traverse: Make, link: tuple[str, int, str, int], reason: str
) -> None:
    routes = [make_traverse(30, name=name) for name in "AB"]
    with pytest.raises(MapError, match=reason):
        join_routes(routes, [link])


def test_no_segment_of_a_map_lies_in_two_routes_and_a_record_names_each(
    make_traverse: Make,
) -> None:
    config = Config.model_validate({"metric": {"kind": "identity"}})
    whole = make_traverse(180)
    parts = [
        replace(
            whole,
            name=name,
            raw=whole.raw[start : start + 60],
            stamps=whole.stamps[start : start + 60],
            thumbnails=whole.thumbnails[start : start + 60],
        )
        for name, start in (("A", 0), ("B", 60), ("C", 120))
    ]
    built = build_map([join_routes(parts)], config)
    assert [(record.name, record.frames) for record in built.traverses] == [
        ("A", 60),
        ("B", 60),
        ("C", 60),
    ]
    for channel in built.channels:
        assert (channel.segments[:, 0] // 60 == (channel.segments[:, 1] - 1) // 60).all()


def test_routes_keep_their_local_features_and_one_without_has_none_of_any_frame(
    make_traverse: Make,
) -> None:
    with_views, without = make_traverse(20, name="north"), make_traverse(12, name="south")
    views = tuple(
        LocalFeatures(np.full((3, 2), number, np.float32), np.zeros((3, 128), np.uint8))
        for number in range(20)
    )
    onnx = np.arange(3, dtype=np.uint8)
    with_views = replace(with_views, local_features=views, local_network=onnx)
    network = join_routes([without, with_views])
    assert network.local_network is onnx
    network = join_routes([with_views, without])
    assert [len(view.points) for view in network.local_features] == [3] * 20 + [0] * 12
    assert network.local_features[7] is views[7]
    assert join_routes([without, without]).local_features == ()
