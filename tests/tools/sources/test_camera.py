import time

import cv2
import numpy as np
import pytest

from placefield.errors import SourceError
from placefield_tools.sources import open_source


class Capture:
    """Stand in for OpenCV's capture: six frames, the fourth damaged, then unplugged."""

    def __init__(self, _device):
        self.index = -1
        self.released = False

    def isOpened(self):  # noqa: N802
        return True

    def get(self, _property):
        return 0.0

    def grab(self):
        self.index += 1
        return self.index < 6

    def retrieve(self):
        return self.index != 3, np.full((8, 8, 3), self.index, np.uint8)

    def release(self):
        self.released = True


def test_a_camera_is_live_and_gives_frames_until_it_is_unplugged(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    before = time.time_ns()
    with open_source("/dev/video2", start=1, stride=2) as source:
        assert source.live
        assert source.count is None
        assert source.frame_rate is None
        arriving = iter(source)
        frames = [next(arriving), next(arriving)]
        with pytest.raises(SourceError, match="camera:2: gives no more"):
            next(arriving)
    assert [frame.index for frame in frames] == [1, 5]
    assert [frame.image[0, 0, 0] for frame in frames] == [1, 5]
    assert before <= frames[0].stamp_ns <= frames[1].stamp_ns <= time.time_ns()


def test_the_camera_is_given_back(monkeypatch):
    capture = Capture(0)
    monkeypatch.setattr(cv2, "VideoCapture", lambda _device: capture)
    with open_source("camera:0"):
        assert not capture.released
    assert capture.released
