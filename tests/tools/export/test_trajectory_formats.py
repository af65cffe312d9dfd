"""Trajectories as the libraries that are used with them read them."""

import dataclasses
import json
import math
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import gpxpy
import numpy as np
import pytest
from evo.core.trajectory import PoseTrajectory3D
from evo.tools.file_interface import read_tum_trajectory_file
from turning_route import ORIGIN, STAMP_NS

from placefield.errors import MapError
from placefield_tools.export.geojson import to_geojson
from placefield_tools.export.gpx import to_gpx
from placefield_tools.export.matched_traverse import QueryTraverse
from placefield_tools.export.tum import to_tum


def read_tum(text: str, folder: Path) -> PoseTrajectory3D:
    path = folder / "drive.tum"
    path.write_text(text)
    return read_tum_trajectory_file(path)


def test_evo_reads_a_tum_trajectory(traverse: QueryTraverse, tmp_path: Path) -> None:
    read = read_tum(to_tum(traverse), tmp_path)
    assert read.check()[0]
    np.testing.assert_array_equal(read.positions_xyz, [[2, 0, 0], [4, 0, 0], [4, 4, 0]])
    yaws = read.get_orientations_euler("sxyz")[:, 2]
    np.testing.assert_allclose(np.cos(yaws), [1, 0, -1], atol=1e-12)
    np.testing.assert_allclose(np.sin(yaws), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(np.diff(read.timestamps), [0.1, 0.2], atol=1e-6)


@pytest.mark.parametrize("stamp_ns", [STAMP_NS, -5, 0, 2**63 - 1])
def test_a_tum_stamp_is_exact(traverse: QueryTraverse, stamp_ns: int) -> None:
    first = traverse.matches[0]
    header = first.header.model_copy(update={"stamp_ns": stamp_ns})
    one = dataclasses.replace(traverse, matches=[dataclasses.replace(first, header=header)])
    whole, _, fraction = to_tum(one).split(" ")[0].partition(".")
    digits = int(fraction.ljust(9, "0") or "0")
    assert int(whole) * 10**9 + (-digits if whole.startswith("-") else digits) == stamp_ns


def test_geojson_has_the_line_and_a_point_for_each_match(traverse: QueryTraverse) -> None:
    collection = json.loads(to_geojson(traverse))
    assert collection["type"] == "FeatureCollection"
    line, *points = collection["features"]
    assert {feature["type"] for feature in collection["features"]} == {"Feature"}
    assert line["geometry"]["type"] == "LineString"
    assert [point["geometry"]["type"] for point in points] == ["Point"] * 3
    positions = [point["geometry"]["coordinates"] for point in points]
    assert line["geometry"]["coordinates"] == positions
    for (longitude, latitude), localised in zip(positions, traverse.matches, strict=True):
        local = ORIGIN.to_local(latitude, longitude)
        assert local == pytest.approx(localised.pose[:2], abs=1e-3)
    assert points[0]["properties"] == {
        "stream": "drive",
        "sequence": 0,
        "stamp_ns": STAMP_NS,
        "place": 1,
        "score": 1.0,
        "probability": 0.995,
        "known": True,
    }


def test_one_match_alone_is_no_line(traverse: QueryTraverse) -> None:
    alone = dataclasses.replace(traverse, matches=traverse.matches[:1])
    (point,) = json.loads(to_geojson(alone))["features"]
    assert point["geometry"]["type"] == "Point"


def test_gpxpy_reads_a_gpx_track(traverse: QueryTraverse) -> None:
    read = gpxpy.parse(to_gpx(traverse))
    (track,) = read.tracks
    (segment,) = track.segments
    assert track.name == "drive"
    assert [point.name for point in segment.points] == ["place 1", "place 2", "place 4"]
    for point, localised in zip(segment.points, traverse.matches, strict=True):
        local = ORIGIN.to_local(point.latitude, point.longitude)
        assert local == pytest.approx(localised.pose[:2], abs=1e-3)
    assert segment.points[0].time == datetime(2023, 11, 14, 22, 13, 20, 123456, UTC)
    assert segment.length_2d() == pytest.approx(2 + 4, rel=0.01)


def test_a_stream_of_any_name_is_a_track_that_gpxpy_reads(traverse: QueryTraverse) -> None:
    first = traverse.matches[0]
    header = first.header.model_copy(update={"stream": "a\0b\x1b"})
    named = replace(traverse, matches=[replace(first, header=header), *traverse.matches[1:]])
    assert gpxpy.parse(to_gpx(named)).tracks[0].name == r"a\x00b\x1b"


@pytest.mark.parametrize("write", [to_geojson, to_gpx])
def test_of_a_map_that_is_not_georeferenced_is_said_how_to_get_one(
    traverse: QueryTraverse, write: Callable[[QueryTraverse], str]
) -> None:
    with pytest.raises(MapError, match="latitude and longitude"):
        write(dataclasses.replace(traverse, pose_frame="route"))


def test_the_yaw_of_a_tum_line_is_about_z(traverse: QueryTraverse) -> None:
    x, y, z, w = map(float, to_tum(traverse).splitlines()[1].split(" ")[4:])
    assert (x, y) == (0, 0)
    assert 2 * math.atan2(z, w) == pytest.approx(math.pi / 2)
