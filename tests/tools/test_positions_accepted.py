"""Positions of the kinds that went wrong for others, from a source to a map."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from placefield.config import Config
from placefield.maps.geography import Origin
from placefield.maps.map import Map
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.inspect.map_facts import map_facts
from placefield_tools.sources import NO_PARTS, Parts
from placefield_tools.sources.recorded_poses import trajectory_of

CASES = Path(
    os.environ.get("PLACEFIELD_CASES") or Path(__file__).resolve().parents[3] / "shared" / "cases"
)
CONFIG = Config.model_validate(
    {"scales": {"channels": 2, "min_scale": 2}, "metric": {"kind": "identity"}}
)


def built(name: str, parts: Parts = NO_PARTS) -> Map:
    if not (CASES / name).exists():
        pytest.skip(f"no {name} at {CASES}; say where it is with PLACEFIELD_CASES")
    return build_from([str(CASES / name)], CONFIG, parts=parts)


def test_a_receiver_that_says_0_0_at_first_does_not_move_the_route() -> None:
    found = built("gps_zero_before_fix/drive.mcap")
    assert found.places.count == 24
    known = found.places.poses[np.isfinite(found.places.poses[:, 0])]
    assert 0 < len(known) < 24
    assert np.abs(known[:, :2]).max() < 100
    origin = Origin.of_frame(found.pose_frame)
    assert origin is not None
    assert (origin.latitude, origin.longitude) == pytest.approx((50, 8), abs=0.01)


def test_photographs_have_poses_where_they_have_a_fix() -> None:
    found = built("gps_gap_photographs/photographs")
    nowhere = [at for at in range(24) if found.places.pose(at) is None]
    assert nowhere == [8, 9, 10, 11, 12, 13]
    assert map_facts(found)["places"].endswith("6 places without")


def test_frames_without_stamps_are_where_the_line_of_their_number_says() -> None:
    parts = Parts(poses=CASES / "poses_by_invented_stamps/5hz.tum")
    poses = built("poses_by_invented_stamps/frames", parts).places.poses
    np.testing.assert_allclose(poses[:, 0], np.arange(60) / 2, atol=1e-9)


def test_a_camera_s_axes_are_reported_and_taken(caplog: pytest.LogCaptureFixture) -> None:
    file = CASES / "poses_in_the_camera_frame/orbslam.txt"
    built("poses_by_invented_stamps/frames", Parts(poses=file))
    assert "give --pose-axes z-forward" in caplog.text
    found = built("poses_by_invented_stamps/frames", Parts(poses=file, pose_axes="z-forward"))
    assert found.places.travelled[-1] == pytest.approx(29.5)


def a_pose(x: float, y: float, z: float) -> SimpleNamespace:
    position = SimpleNamespace(x=x, y=y, z=z)
    return SimpleNamespace(
        pose=SimpleNamespace(
            position=position, orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        )
    )


@pytest.mark.parametrize("nowhere", [(0.0, 0.0), (-0.0, 0.0), (np.nan, 8.0), (50.0, np.inf)])
def test_a_location_that_is_none_is_no_pose_and_moves_no_origin(
    nowhere: tuple[float, float],
) -> None:
    degrees = [nowhere, (50.0, 8.0), nowhere, (50.00001, 8.0), nowhere]
    fixes = [
        (at * 10**9, SimpleNamespace(latitude=latitude, longitude=longitude))
        for at, (latitude, longitude) in enumerate(degrees)
    ]
    way = trajectory_of("a.mcap:/fix", "foxglove.LocationFix", fixes)
    assert way.origin == Origin(50.0, 8.0)
    assert way.trajectory.stamps.tolist() == [10**9, 3 * 10**9]
    assert way.span_ns == (0, 4 * 10**9)


def test_poses_of_visual_slam_in_a_recording_are_reported(
    caplog: pytest.LogCaptureFixture,
) -> None:
    ahead = [(at * 10**8, a_pose(0.01, 0.02, at / 2)) for at in range(20)]
    trajectory_of("a.mcap:/slam", "geometry_msgs/msg/PoseStamped", ahead)
    assert "9.5 m vertically" in caplog.text
    assert "--pose-axes z-forward" in caplog.text


@pytest.mark.filterwarnings("error")
def test_a_pose_beyond_all_metres_is_none() -> None:
    said = [(0, a_pose(1e300, 0, 0)), (10**9, a_pose(1, 2, 0)), (2 * 10**9, a_pose(0, -1e200, 0))]
    way = trajectory_of("a.mcap:/slam", "geometry_msgs/msg/PoseStamped", said)
    assert way.trajectory.states[:, :2].tolist() == [[1, 2]]
