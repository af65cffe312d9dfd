import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import islice

import cv2
import numpy as np
import pytest

from placefield.errors import SourceError
from placefield_tools.sources import Parts, camera, open_source

FRAMES = 6


class Capture:
    """Stand in for OpenCV's capture: six frames, the fourth damaged, then unplugged."""

    opened = 0
    absent = ()  # the numbers of the captures that find no camera

    def __init__(self, _device):
        self.index = -1
        self.released = False
        self.is_there = Capture.opened not in Capture.absent
        Capture.opened += 1

    def isOpened(self):  # noqa: N802
        return self.is_there

    def grab(self):
        self.index += 1
        return self.is_there and self.index < FRAMES

    def retrieve(self):
        return self.index != 3, np.full((8, 8, 3), self.index, np.uint8)

    def release(self):
        self.released = True


class Waits(threading.Event):
    """An event that says how long it was waited for, waits for nothing, and is then set."""

    def __init__(self, most):
        super().__init__()
        self.waited = []
        self._most = most

    def wait(self, timeout):
        self.waited.append(timeout)
        if len(self.waited) == self._most:
            self.set()
        return self.is_set()


@pytest.fixture
def capture(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    monkeypatch.setattr(Capture, "opened", 0)
    return Capture


def test_a_camera_is_live_and_stamps_its_frames_on_arrival(capture):
    before = time.time_ns()
    with open_source("/dev/video2", parts=Parts(start=1, stride=2)) as source:
        assert source.live
        assert source.count is None
        arriving = iter(source)
        frames = [next(arriving), next(arriving)]
    assert [frame.index for frame in frames] == [1, 5]
    assert [frame.image[0, 0, 0] for frame in frames] == [1, 5]
    assert before <= frames[0].stamp_ns <= frames[1].stamp_ns <= time.time_ns()


def test_a_camera_that_is_gone_is_waited_for_longer_and_longer(capture, monkeypatch, caplog):
    monkeypatch.setattr(capture, "absent", range(1, 10))
    stop = Waits(11)
    with open_source("camera:0", stop=stop) as source:
        frames = list(source)
    assert stop.waited == [0.5, 1, 2, 4, 8, 16, 30, 30, 30, 30, 0.5]
    assert [frame.index for frame in frames[:5]] == [0, 1, 2, 4, 5]
    assert len(frames) == 10  # and the numbers go on
    assert all(frame.index > 5 for frame in frames[5:])
    back = [message for message in caplog.messages if "reconnects" in message]
    assert back == ["camera:0: is back; reconnects so far: 1"]


def test_the_camera_is_given_back(monkeypatch):
    capture = Capture(0)
    monkeypatch.setattr(cv2, "VideoCapture", lambda _device: capture)
    with open_source("camera:0"):
        assert not capture.released
    assert capture.released


def test_closing_ends_the_frames_and_leaves_the_callers_event_alone(capture):
    stop = threading.Event()
    source = open_source("camera:0", stop=stop)
    arriving = iter(source)
    next(arriving)
    source.close()
    assert list(arriving) == []
    assert not stop.is_set()


def test_a_camera_of_damaged_frames_alone_is_stopped_too(capture, monkeypatch):
    stop = threading.Event()
    monkeypatch.setattr(capture, "grab", lambda _self: True)
    monkeypatch.setattr(capture, "retrieve", lambda _self: (stop.set(), None))
    assert list(open_source("camera:0", stop=stop)) == []


class NetworkCamera(BaseHTTPRequestHandler):
    """Sends six frames as MJPEG over HTTP, of the brightness 10, 30, …, and breaks off."""

    visits = 0

    def do_GET(self) -> None:
        NetworkCamera.visits += 1
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for index in range(FRAMES):
            jpeg = cv2.imencode(".jpg", np.full((48, 64, 3), 20 * index + 10, np.uint8))[1]
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            self.wfile.write(head.encode() + jpeg.tobytes() + b"\r\n")

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def address() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), NetworkCamera) as server:
        threading.Thread(target=server.serve_forever).start()
        yield f"127.0.0.1:{server.server_port}"
        server.shutdown()


def test_a_camera_of_the_network_comes_back_after_its_stream_broke_off(
    address, monkeypatch, caplog, capfd
):
    monkeypatch.setattr(camera, "_FIRST_WAIT_S", 0.01)
    with open_source(f"http://user:secret@{address}/video?key=secret") as source:
        assert source.live
        frames = list(islice(source, 2 * FRAMES))
    assert NetworkCamera.visits == 2
    brightness = [round(float(frame.image.mean())) for frame in frames]
    assert brightness == [20 * index + 10 for index in range(FRAMES)] * 2
    assert frames[1].name == f"http://{address}/video#1"
    assert "reconnects so far: 1" in caplog.text
    err = capfd.readouterr().err
    assert "secret" not in caplog.text + frames[0].name + err
    # If a command ran in this process before, our log goes there; OpenCV's never does.
    assert all(line.startswith("placefield: ") for line in err.splitlines())


@pytest.mark.parametrize("scheme", ["rtsp", "http"])
def test_a_camera_of_the_network_that_does_not_answer_is_refused(scheme, capfd):
    with pytest.raises(SourceError, match=f"^{scheme}://127.0.0.1:1/a: cannot be opened"):
        open_source(f"{scheme}://me:secret@127.0.0.1:1/a")
    assert capfd.readouterr().err == ""
