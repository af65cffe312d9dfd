import contextlib
from pathlib import Path

import numpy as np
import pytest
from evo.core.trajectory import PosePath3D, PoseTrajectory3D
from evo.tools import file_interface
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from placefield.errors import SourceError
from placefield_tools.sources.pose_files import read_pose_file

COUNT = 7
RNG = np.random.default_rng(4)
POSITIONS = RNG.uniform(-9, 9, (COUNT, 3))
YAWS = RNG.uniform(-3, 3, COUNT)
SECONDS = 1_700_000_000 + np.arange(COUNT) / 10


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_tum_file_that_evo_wrote_is_read_as_evo_reads_it(tmp_path: Path) -> None:
    tilted = Rotation.from_euler("ZYX", np.column_stack([YAWS, np.full(COUNT, 0.2), 0.1 * YAWS]))
    wxyz = tilted.as_quat()[:, [3, 0, 1, 2]]
    path = tmp_path / "a.txt"
    file_interface.write_tum_trajectory_file(path, PoseTrajectory3D(POSITIONS, wxyz, SECONDS))

    file = read_pose_file(path)

    theirs = file_interface.read_tum_trajectory_file(path)
    assert not file.numbered
    np.testing.assert_allclose(file.trajectory.stamps / 1e9, theirs.timestamps, atol=1e-6)
    found = file.trajectory.at(file.trajectory.stamps)
    np.testing.assert_allclose(found[:, :2], theirs.positions_xyz[:, :2], atol=1e-12)
    yaws = theirs.get_orientations_euler("rzyx")[:, 0]
    np.testing.assert_allclose(yaws, tilted.as_euler("ZYX")[:, 0], atol=1e-6)
    np.testing.assert_allclose(found[:, 2], yaws, atol=1e-6)


def test_a_tum_stamp_keeps_its_nanoseconds_and_remarks_are_left_out(tmp_path: Path) -> None:
    text = "# stamp tx …\n\n1700000000.123456789,1,2,3,0,0,0.7071067811865476,0.7071067811865476\n"
    trajectory = read_pose_file(written(tmp_path / "a.tum", text)).trajectory
    assert trajectory.stamps.tolist() == [1_700_000_000_123_456_789]
    assert trajectory.states[0].tolist() == pytest.approx([1, 2, np.pi / 2, 0])


def test_a_kitti_file_that_evo_wrote_lies_on_the_ground_of_the_camera(tmp_path: Path) -> None:
    """KITTI's camera looks along z, and has x on its right and y below it."""
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    poses[:, :3, 3] = POSITIONS
    # Seen from above, a turn to the left is one about the axis that points up: minus y.
    poses[:, :3, :3] = Rotation.from_rotvec(YAWS[:, np.newaxis] * [0, -1, 0]).as_matrix()
    path = tmp_path / "00.txt"
    file_interface.write_kitti_poses_file(path, PosePath3D(poses_se3=list(poses)))

    file = read_pose_file(path)

    assert file.numbered
    keys = np.array([file.key(index, stamp_ns=5) for index in range(COUNT)])
    found = file.trajectory.at(keys)
    theirs = file_interface.read_kitti_poses_file(path).positions_xyz
    np.testing.assert_allclose(found[:, :2], np.column_stack([theirs[:, 2], -theirs[:, 0]]))
    np.testing.assert_allclose(found[:, 2], YAWS, atol=1e-6)
    steps = np.linalg.norm(np.diff(POSITIONS[:, [0, 2]], axis=0), axis=1)
    np.testing.assert_allclose(np.diff(found[:, 3]), steps, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "holds no poses"),
        ("# stamp\n", "holds no poses"),
        ("# a remark\n1 2 3\n", "line 2: 3 numbers; a line has 8"),
        ("1 2 3 4 0 0 0 1\n2 3 4 0 0 0 1\n", "line 2: has 7 numbers, and the first line has 8"),
        ("1 2 3 4 0 0 0 nan\n", "line 1: a number is not finite"),
        ("1 2 3 4 0 0 0 1e300\n", "line 1: the number 1e[+]300 is too large"),
        ("1 -1e12 3 4 0 0 0 1\n", "line 1: the number -1e[+]12 is too large"),
        ("1 2 3 4 0 0 0 one\n", "line 1: could not convert"),
        ("-1 2 3 4 0 0 0 1\n", "line 1: the stamp '-1'"),
    ],
)
def test_a_malformed_file_of_poses_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(SourceError, match=complaint) as refused:
        read_pose_file(written(tmp_path / "poses.txt", text))
    assert "poses.txt" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_missing_or_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="nowhere"):
        read_pose_file(tmp_path / "nowhere")
    (tmp_path / "a.tum").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SourceError, match=r"a\.tum"):
        read_pose_file(tmp_path / "a.tum")


def way(shape: str) -> tuple[np.ndarray, np.ndarray]:
    """A drive on a road that rises a little: x, y and z up, and yaws."""
    at = np.linspace(0, 1, 40)
    if shape == "straight":
        return np.column_stack([80 * at, 0 * at, 2 * at]), 0 * at
    angles = 2 * np.pi * at
    circle = np.column_stack([20 * np.sin(angles), 20 - 20 * np.cos(angles), np.sin(angles)])
    return circle, angles


def as_camera(positions: np.ndarray, yaws: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same seen from the first camera: positions, and rotations as matrices."""
    axes = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]])  # rows: right, down, forward
    turned = Rotation.from_euler("z", yaws[:, np.newaxis]).as_matrix()
    return positions @ axes.T, axes @ turned @ axes.T


def tum_text(positions: np.ndarray, rotations: Rotation) -> str:
    table = np.column_stack([np.arange(len(positions)), positions, rotations.as_quat()])
    return "\n".join(" ".join(f"{cell:.12f}" for cell in row) for row in table)


@pytest.mark.parametrize("shape", ["straight", "circle"])
@pytest.mark.parametrize("form", ["tum", "kitti"])
@pytest.mark.parametrize("axes", ["x-forward", "z-forward"])
def test_a_drive_is_the_same_in_either_axes_if_these_are_said(
    tmp_path: Path, shape: str, form: str, axes: str, caplog: pytest.LogCaptureFixture
) -> None:
    positions, yaws = way(shape)
    rotations = Rotation.from_euler("z", yaws[:, np.newaxis]).as_matrix()
    there, turned = (positions, rotations) if axes == "x-forward" else as_camera(positions, yaws)
    text = tum_text(there, Rotation.from_matrix(turned))
    if form == "kitti":
        rows = np.concatenate([turned, there[:, :, np.newaxis]], axis=2).reshape(-1, 12)
        text = "\n".join(" ".join(map(str, row)) for row in rows)
    poses = read_pose_file(written(tmp_path / "a.txt", text), axes).poses
    np.testing.assert_allclose(poses[:, :2], positions[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * poses[:, 2]), np.exp(1j * yaws), atol=1e-9)
    assert not caplog.messages


@pytest.mark.parametrize("shape", ["straight", "circle"])
def test_a_camera_s_axes_taken_for_a_vehicle_s_are_reported(
    tmp_path: Path, shape: str, caplog: pytest.LogCaptureFixture
) -> None:
    there, turned = as_camera(*way(shape))
    read_pose_file(written(tmp_path / "a.tum", tum_text(there, Rotation.from_matrix(turned))))
    (reported,) = caplog.messages
    assert "vertically" in reported
    assert reported.endswith("give --pose-axes z-forward")
    assert "\n" not in reported


def test_a_vehicle_that_stands_has_no_suspicious_axes(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    read_pose_file(written(tmp_path / "a.tum", "0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1"))
    assert not caplog.messages


CELLS = st.sampled_from(
    ["0", "1", "-1.5", "1e300", "9e11", "1e308", "1e99999", "nan", "inf", "#", "x", "1_0", "²"]
)


@pytest.mark.filterwarnings("error")
@given(
    st.binary(max_size=60)
    | st.lists(
        st.sampled_from([8, 12, 3]).flatmap(
            lambda count: st.lists(CELLS, min_size=count, max_size=count).map(" ".join)
        ),
        max_size=4,
    ).map(lambda lines: "\n".join(lines).encode())
)
def test_no_file_gives_anything_but_poses_or_a_source_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.poses"
    path.write_bytes(content)
    with contextlib.suppress(SourceError):
        file = read_pose_file(path)
        assert len(file.trajectory.stamps) == len(file.trajectory.states) >= 1
