import cv2
import numpy as np
import pytest

from placefield_tools.doctor import camera_check as cameras
from placefield_tools.doctor.camera_check import of_camera
from placefield_tools.doctor.finding import Health

URL = "rtsp://me:sec/ret@host/stream?key=secret"


class Capture:
    """Stand in for OpenCV's capture of a camera that opens, and gives frames or none."""

    gives = True

    def __init__(self, *_where: object) -> None:
        pass

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def grab(self) -> bool:
        return self.gives

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.zeros((20, 30, 3), np.uint8)

    def release(self) -> None:
        pass


@pytest.fixture
def capture(monkeypatch: pytest.MonkeyPatch) -> type[Capture]:
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    return Capture


@pytest.mark.usefixtures("capture")
def test_a_camera_that_gives_a_frame_is_good_and_its_password_not_reported() -> None:
    found = of_camera(URL)
    assert found.verdict is Health.GOOD
    assert found.found == "rtsp://host/stream gives frames of (30, 20) pixels"


@pytest.mark.timeout(60)  # it used to wait for ever
def test_a_camera_that_opens_and_gives_no_frame_is_bad(
    capture: type[Capture], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capture, "gives", False)
    monkeypatch.setattr(cameras, "_PATIENCE_S", 0.01)
    found = of_camera(URL)
    assert found.verdict is Health.BAD
    assert found.found == "rtsp://host/stream gives no frame"


def test_a_camera_that_does_not_open_is_bad_and_its_password_not_reported() -> None:
    found = of_camera("rtps://me:secret@host/stream")
    assert found.verdict is Health.BAD
    assert "secret" not in found.found
