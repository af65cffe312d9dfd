"""The calibration of a camera in a recording, beside its images."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lenses import Lens, pinhole
from mcap.writer import Writer
from test_ros_recording import FORMATS, Said, images, record

from placefield.config import Config
from placefield.errors import SourceError
from placefield.features.rectification import view_of
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.build.used_part import AskedPart
from placefield_tools.sources import Parts, open_source
from placefield_tools.sources.calibration_files import calibration_in

INFO = "sensor_msgs/msg/CameraInfo"
FRONT = Lens("pinhole", (-0.25, 0.05), 24, 16, (19.0, 20.5), (11.0, 8.0))
REAR = Lens("fisheye", (0.04, -0.01, 2e-05, 0.0), 24, 16, (15.0, 14.8), (12.0, 7.0))

RAW, COMPRESSED = "/front/image_raw", "/front/image_raw/compressed"


def info(lens: Lens, form: str = "mcap", **changed: Any) -> dict[str, Any]:
    """Return the fields of the camera's message, whose names in ROS 1 are capitals."""
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    k, d = ("K", "D") if form == "ros1" else ("k", "d")
    return {
        "width": lens.width,
        "height": lens.height,
        "distortion_model": "equidistant" if lens.model == "fisheye" else "plumb_bob",
        k: np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
        d: np.array(lens.calibration.distortion, np.float64),
    } | changed


def said(lens: Lens, topic: str = "/front/camera_info", second: float = 0, **how: Any) -> Said:
    return Said(topic, INFO, second, info(lens, **how))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("lens", [FRONT, REAR])
def test_the_first_message_beside_the_images_is_the_calibration_of_all_frames(
    tmp_path: Path, form: str, lens: Lens
) -> None:
    later, other = pinhole(24, 16, 30), pinhole(24, 16, 31)
    messages = [
        said(lens, form=form),
        said(later, second=1, form=form),
        said(other, "/rear/camera_info", form=form),
    ]
    where = record(tmp_path / "drive", [*images(COMPRESSED), *messages], form)
    with open_source(where, parts=Parts(camera=Path(where))) as source:
        frames = list(source)
    assert {frame.calibration for frame in frames} == {lens.calibration}
    assert source.calibration == lens.calibration


def test_the_topic_of_the_images_chooses_the_camera(tmp_path: Path) -> None:
    every = [*images(RAW), *images("/rear/image_raw")]
    every += [said(FRONT), said(REAR, "/rear/camera_info")]
    where = Path(record(tmp_path / "drive", every))
    assert calibration_in(where, RAW) == FRONT.calibration
    assert calibration_in(where, "/rear/image_raw") == REAR.calibration
    with pytest.raises(SourceError, match="on /front/camera_info, /rear/camera_info; choose with"):
        calibration_in(where)


def test_the_only_camera_of_a_recording_is_taken_and_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    where = Path(record(tmp_path / "drive", [*images("/cam/image"), said(REAR, "/lens")]))
    assert calibration_in(where) == REAR.calibration
    assert "the camera of /cam/image is taken to be that of /lens" in caplog.text
    caplog.clear()
    alone = Path(record(tmp_path / "alone", [said(FRONT)]))
    assert calibration_in(alone) == FRONT.calibration
    assert not caplog.text


def test_a_folder_of_recordings_and_a_query_camera_are_read(tmp_path: Path) -> None:
    folder = tmp_path / "drives"
    folder.mkdir()
    record(folder / "drive_0", images(COMPRESSED))
    narrow = pinhole(24, 16, 40)
    record(folder / "drive_1", [said(narrow)])
    yaml = FRONT.write(tmp_path / "front.yaml")
    assert calibration_in(folder) == narrow.calibration
    used = AskedPart(query_cameras=[folder]).found(Parts(camera=yaml), pytest.fail)
    assert used.view == view_of(FRONT.calibration).common(view_of(narrow.calibration))
    assert used.view != view_of(FRONT.calibration)


def test_a_calibration_of_foxglove_is_read(tmp_path: Path) -> None:
    file = tmp_path / "drive.mcap"
    (fx, fy), (cx, cy) = FRONT.focal, FRONT.centre
    fields = {
        "timestamp": {"sec": 1, "nsec": 0},
        "width": 24,
        "height": 16,
        "distortion_model": "plumb_bob",
        "D": [*FRONT.calibration.distortion],
        "K": [fx, 0, cx, 0, fy, cy, 0, 0, 1],
    }
    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foxglove.CameraCalibration", "jsonschema", b"{}")
        channel = writer.register_channel("/calibration", "json", schema)
        writer.add_message(channel, 1, json.dumps(fields).encode(), 1)
        writer.finish()
    assert calibration_in(file) == FRONT.calibration


@pytest.mark.parametrize(
    ("messages", "reason"),
    [
        ([], r"has no topic of CameraInfo; it holds /front/image_raw \(.*\); give the .* in YAML"),
        ([said(FRONT, distortion_model="omni")], "camera_info: distortion_model: 'omni'; give plu"),
        ([said(FRONT, k=np.zeros(9))], "camera_info: k: is 0: this camera has not been calibrated"),
        ([said(FRONT, d=np.ones(3))], "camera_info: d: 3 coefficients, and a pinhole has 0 or 4"),
        ([said(FRONT, width=0)], "camera_info: width: .*greater"),
        (
            [said(FRONT, roi={"width": 12, "height": 8})],
            "camera_info: roi: the images are a part of 12×8 of the calibrated 24×16",
        ),
    ],
)
def test_a_recording_without_a_calibration_is_refused_in_one_line(
    tmp_path: Path, messages: list[Said], reason: str
) -> None:
    where = record(tmp_path / "drive", [*images(RAW), *messages])
    with pytest.raises(SourceError, match=rf"^{where}: .*{reason}") as refused:
        open_source(where, parts=Parts(camera=Path(where)))
    assert "\n" not in str(refused.value)


def test_rectified_images_have_no_calibration_beside_them(tmp_path: Path) -> None:
    topic = "/front/image_rect_color/compressed"
    where = Path(record(tmp_path / "drive", [*images(topic), said(FRONT)]))
    with pytest.raises(SourceError, match=f"{topic}: the images are rectified, and CameraInfo is"):
        calibration_in(where)


def test_frames_of_another_aspect_ratio_are_refused(tmp_path: Path) -> None:
    where = record(tmp_path / "drive", [*images(RAW), said(pinhole(64, 16, 30))])
    calibrated = "the image is 24×16, and its camera was calibrated for 64×16, of another aspect"
    with pytest.raises(SourceError, match=calibrated):
        build_from([where], Config(), parts=Parts(camera=Path(where)))
