"""Calibrations in the files of ROS and of OpenCV."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from lenses import Lens

from placefield.errors import ConfigError
from placefield.features.camera_file import read_camera, write_camera

PINHOLE = Lens("pinhole", (-0.25, 0.05), 320, 240, (190.0, 200.5), (155.0, 124.0))
FISHEYE = Lens("fisheye", (0.04, -0.01, 2e-05, 0.0), 320, 240, (150.0, 148.0), (161.0, 117.0))


@pytest.mark.parametrize("lens", [PINHOLE, FISHEYE])
def test_a_camera_info_of_ros_is_read(lens: Lens, tmp_path: Path) -> None:
    assert read_camera(lens.write(tmp_path / "front.yaml")) == lens.calibration


def test_a_message_that_ros_prints_is_read(tmp_path: Path) -> None:
    file = tmp_path / "front.yaml"  # of: ros2 topic echo --once /camera/camera_info
    file.write_text(
        """header:
  stamp:
    sec: 12
    nanosec: 5
  frame_id: camera
height: 240
width: 320
distortion_model: plumb_bob
d:
- -0.25
- 0.05
- 0.0
- 0.0
k:
- 190.0
- 0.0
- 155.0
- 0.0
- 200.5
- 124.0
- 0.0
- 0.0
- 1.0
binning_x: 0
roi:
  x_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
"""
    )
    assert read_camera(file) == PINHOLE.calibration


@pytest.mark.parametrize("lens", [PINHOLE, FISHEYE])
@pytest.mark.parametrize("names", [("camera_matrix", "distortion_coefficients"), ("K", "D")])
def test_a_file_that_opencv_writes_is_read(
    lens: Lens, names: tuple[str, str], tmp_path: Path
) -> None:
    file = tmp_path / "camera.yml"
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", lens.width)
    storage.write("image_height", lens.height)
    storage.write(names[0], np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]))
    storage.write(names[1], np.array(lens.calibration.distortion)[:, None])
    if lens.model == "fisheye":
        storage.write("fisheye_model", 1)
    storage.release()
    assert read_camera(file) == lens.calibration
    first, rest = file.read_text().split("\n", 1)
    assert first.startswith("%YAML")
    file.write_text(f"%YAML:1.0\n{rest}")  # as OpenCV 4 writes it
    assert read_camera(file) == lens.calibration


def test_rows_in_lists_and_the_size_in_one_key_are_read(tmp_path: Path) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(
        "K: [[190, 0, 155], [0, 200.5, 124], [0, 0, 1]]\nD: []\nimage_size: [320, 240]\n"
    )
    assert read_camera(file) == PINHOLE.calibration.model_copy(update={"distortion": ()})


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("image_width: 320\n", "", "image_width: missing"),
        ("image_width: 320", "image_width: wide", "image_width: .*integer"),
        ("camera_matrix:", "matrix:", "camera_matrix: missing"),
        ("data: [190.0,", "data: [0,", "camera_matrix: .*greater than 0"),
        ("data: [190.0,", "data: [.nan,", "camera_matrix: .*finite"),
        ("data: [190.0,", "data: [a,", "camera_matrix: has to hold numbers"),
        ("data: [190.0, 0.00000,", "data: [190.0, 0.5,", "camera_matrix: has to be fx, 0, cx"),
        ("plumb_bob", "omnidirectional", "distortion_model: 'omnidirectional'; give plumb_bob"),
        ("[-0.25, 0.05, 0.0, 0.0]", "[1, 2]", "distortion_coefficients: 2 coefficients, and a pin"),
        ("plumb_bob", "[plumb_bob]", "distortion_model: .*; give plumb_bob"),
        ("image_width", "\t- {", "not valid YAML"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused_in_one_line(
    old: str, new: str, reason: str, tmp_path: Path
) -> None:
    file = PINHOLE.write(tmp_path / "front.yaml")
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(ConfigError, match=rf"^{file}: .*{reason}") as refused:
        read_camera(file)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"\xff\xd8\xff", "not valid YAML"),
        (b"- 1\n", "holds no keys"),
        (b"", "holds no keys"),
        (b"!!python/object:os.system {}", "not valid YAML"),
        (b"a: " + b"[" * 3000, "not valid YAML"),
        (b"#" * 2**21, "more than 1048576 bytes"),
    ],
)
def test_any_other_file_is_refused(content: bytes, reason: str, tmp_path: Path) -> None:
    file = tmp_path / "front.yaml"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=reason):
        read_camera(file)
    with pytest.raises(ConfigError, match=r"no\.yaml: cannot be read: No such file"):
        read_camera(tmp_path / "no.yaml")


@pytest.mark.parametrize("lens", [PINHOLE, FISHEYE])
def test_a_calibration_that_was_written_is_read_to_the_same_bits(
    lens: Lens, tmp_path: Path
) -> None:
    third = lens.calibration.model_copy(update={"focal": (100 / 3, 1e-5 / 3)})
    write_camera(third, tmp_path / "camera.yaml")
    assert read_camera(tmp_path / "camera.yaml") == third
