import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from placefield.maps.trajectory import Trajectory, directions, travelled

S = 1_000_000_000
EPOCH = 1_700_000_000 * S + 123


def trajectory(*rows: tuple[float, float, float, float]) -> Trajectory:
    """Poses, each behind its second since an epoch."""
    table = np.array(rows, np.float64)
    return Trajectory.of(EPOCH + (table[:, 0] * S).astype(np.int64), table[:, 1:])


def at(way: Trajectory, *seconds: float) -> np.ndarray:
    return way.at(np.array([EPOCH + int(second * S) for second in seconds]))


def test_at_a_pose_s_stamp_the_pose_comes_bit_for_bit() -> None:
    poses = np.random.default_rng(1).uniform(-3, 3, (9, 3))
    way = trajectory(*[(second, *pose) for second, pose in enumerate(poses)])
    found = at(way, *range(9))
    np.testing.assert_array_equal(found[:, :2], poses[:, :2])
    np.testing.assert_allclose(found[:, 2], poses[:, 2], atol=1e-12)
    np.testing.assert_array_equal(found[:, 3], travelled(poses))


def test_between_poses_it_is_on_the_straight_line_and_turns_the_short_way() -> None:
    way = trajectory((0, 0, 0, 3), (1, 4, 0, -3), (2, 4, 8, -1))
    asked = np.linspace(0, 2, 21)
    found = at(way, *asked)
    np.testing.assert_allclose(found[:, 0], np.minimum(4 * asked, 4), atol=1e-9)
    np.testing.assert_allclose(found[:, 1], np.maximum(8 * (asked - 1), 0), atol=1e-9)
    np.testing.assert_allclose(found[:, 3], found[:, 0] + found[:, 1], atol=1e-9)
    rotations = Rotation.from_euler("z", [[3], [-3], [-1]])
    turns = Slerp([0, 1, 2], rotations)(asked).as_euler("zyx")[:, 0]
    np.testing.assert_allclose(found[:, 2], turns, atol=1e-7)


def test_over_two_seconds_nobody_knows_the_way() -> None:
    way = trajectory((0, 0, 0, 0), (2, 2, 0, 0), (4.5, 5, 0, 0))
    known = ~np.isnan(at(way, 0, 1, 2, 2.1, 4.4, 4.5)[:, 0])
    assert known.tolist() == [True, True, True, False, False, True]


def test_the_ends_hold_for_half_a_step_and_what_is_further_out_is_not_covered() -> None:
    way = trajectory((0, 1, 2, 3), (0.5, 5, 6, 7), (1, 8, 9, 1))
    found = at(way, -0.3, -0.25, 1.25, 1.3)
    assert found[1:3, 0].tolist() == [1, 8]
    assert np.isnan(found[[0, 3]]).all()
    covered = [way.covers(EPOCH + int(second * S)) for second in (-0.3, -0.25, 0.7, 1.25, 1.3)]
    assert covered == [False, True, True, True, False]


def test_poses_may_come_in_any_order_and_twice() -> None:
    way = trajectory((1, 10, 0, 0), (0, 0, 0, 0), (1, 99, 0, 0))
    assert at(way, 0.5)[0].tolist() == [5, 0, 0, 5]


def test_one_pose_is_a_trajectory() -> None:
    way = trajectory((0, 1, 2, 3))
    assert at(way, 0)[0].tolist() == pytest.approx([1, 2, 3, 0])
    assert np.isnan(at(way, 1e-6)).all()


@given(
    st.lists(st.integers(0, 10**10), min_size=1, max_size=20, unique=True),
    st.lists(st.integers(-(10**9), 11 * 10**9), max_size=20),
)
def test_a_batch_of_stamps_gives_what_each_gives_alone(known: list[int], asked: list[int]) -> None:
    poses = np.arange(3.0 * len(known)).reshape(-1, 3)
    way = Trajectory.of(np.array(known), poses)
    alone = [way.at(np.array([stamp]))[0] for stamp in asked]
    np.testing.assert_array_equal(
        way.at(np.array(asked, np.int64)), np.reshape(alone, (len(asked), 4))
    )


def test_a_vehicle_looks_where_it_drives_also_while_it_stands() -> None:
    angles = np.linspace(0, np.pi, 1000)
    circle = 50 * np.column_stack([np.cos(angles), np.sin(angles)])
    yaws = np.unwrap(directions(circle))
    np.testing.assert_allclose(yaws[:-4], angles[:-4] + np.pi / 2, atol=0.01)
    jitter = np.random.default_rng(0).uniform(-0.02, 0.02, (10, 2))
    stationary = np.concatenate([jitter, [[0, -5], [0, -9]]])
    np.testing.assert_allclose(directions(stationary), -np.pi / 2, atol=0.01)
    assert directions(jitter).tolist() == [0] * 10


@given(st.integers(1, 30), st.data())
def test_metres_over_poses_that_nobody_knows_go_on_at_the_mean_step(
    count: int, data: st.DataObject
) -> None:
    """Of a steady straight drive they are what they would be if all poses were known."""
    poses = np.column_stack([np.arange(count) * 3.0, np.arange(count) * 4.0, np.zeros(count)])
    known = data.draw(st.sets(st.integers(0, count - 1), min_size=min(count, 2)))
    some = poses.copy()
    some[[at for at in range(count) if at not in known]] = np.nan
    np.testing.assert_allclose(travelled(some), np.arange(count) * 5.0, atol=1e-9)


def test_metres_are_nought_where_one_pose_is_known() -> None:
    poses = np.full((4, 3), np.nan)
    poses[2] = 7
    assert travelled(poses).tolist() == [0] * 4
