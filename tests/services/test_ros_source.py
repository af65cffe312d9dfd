from collections import Counter

import numpy as np
import pytest
from bus_doubles import RecordingPublisher
from cdr_by_hand import camera_info, compressed_image, image, odometry
from lenses import pinhole

from placefield.bus.messages import FrameMessage, OdometryMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.errors import MessageError
from placefield.features.calibration import Calibration
from placefield.features.distance_sampler import DistanceSampler
from placefield.ros.camera_info import CAMERA_INFO
from placefield.ros.ros_messages import COMPRESSED_IMAGE, IMAGE, ODOMETRY
from placefield_services.ros_source import RosSource

PIXELS = np.random.default_rng(5).integers(0, 256, (8, 9)).astype(np.uint8)


class Stage:
    """A source with its published messages and its counts."""

    def __init__(
        self, spacing: DistanceSampler | None = None, calibration: Calibration | None = None
    ) -> None:
        self.frames = RecordingPublisher(FrameMessage)
        self.odometry: list[OdometryMessage] = []
        self.counts: Counter[str] = Counter()
        frames = CachedPublisher(self.frames, ReplayCache(1))
        put = self.odometry.append
        self.source = RosSource(frames, put, self.counts, spacing, calibration)


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_images_are_the_frames_of_one_live_stream(stage: Stage) -> None:
    stage.source.publish_image(COMPRESSED_IMAGE, compressed_image((1, 5), b"first"))
    stage.source.publish_image(IMAGE, image((2, 0), 8, 9, "mono8", 9, PIXELS.tobytes()))
    stage.source.end()
    first, second, end = (header for header, _ in stage.frames.sent)
    assert {header.stream for header in (first, second, end)} == {first.stream}
    assert [header.sequence for header in (first, second, end)] == [0, 1, 2]
    assert [header.stamp_ns for header in (first, second)] == [1_000_000_005, 2_000_000_000]
    assert all(header.live for header in (first, second, end))
    assert [header.end for header in (first, second, end)] == [False, False, True]
    images = [message.image for _, message in stage.frames.sent if message]
    assert images[0] == b"first"
    assert np.array_equal(images[1], PIXELS)
    assert stage.counts == {"frames": 2}


def test_each_image_has_the_calibration_of_the_camera() -> None:
    calibration = pinhole(9, 8, 7).calibration
    stage = Stage(calibration=calibration)
    stage.source.publish_image(COMPRESSED_IMAGE, compressed_image((1, 5), b"first"))
    assert [message.calibration for _, message in stage.frames.sent if message] == [calibration]


def test_an_image_has_the_calibration_that_came_last() -> None:
    stage, lens = Stage(), pinhole(9, 8, 7)
    matrix = 7, 0, 4, 0, 7, 3.5, 0, 0, 1
    stage.source.publish_image(COMPRESSED_IMAGE, compressed_image((1, 0), b"before"))
    info = camera_info((8, 9), "plumb_bob", matrix, lens.calibration.distortion)
    stage.source.receive_calibration(CAMERA_INFO, info)
    stage.source.publish_image(COMPRESSED_IMAGE, compressed_image((2, 0), b"first"))
    not_calibrated = camera_info((8, 9), "", [0] * 9, [])
    for kind, data, reason in (
        (CAMERA_INFO, not_calibrated, "k: is 0: this camera has not been calibrated"),
        (CAMERA_INFO, info[:-40], "not CDR"),
        (IMAGE, info, f"give a topic of {CAMERA_INFO}"),
    ):
        with pytest.raises(MessageError, match=reason):
            stage.source.receive_calibration(kind, data)
    stage.source.publish_image(COMPRESSED_IMAGE, compressed_image((3, 0), b"second"))
    calibrations = [message.calibration for _, message in stage.frames.sent if message]
    assert calibrations == [None, lens.calibration, lens.calibration]


def test_an_image_that_cannot_be_read_leaves_no_gap(stage: Stage) -> None:
    with pytest.raises(MessageError):
        stage.source.publish_image(IMAGE, b"garbage")
    stage.source.publish_image(COMPRESSED_IMAGE, compressed_image((1, 5), b"first"))
    assert stage.frames.sequences == [0]
    assert stage.counts == {"frames": 1}


def test_a_stream_that_has_not_begun_does_not_end(stage: Stage) -> None:
    stage.source.end()
    assert not stage.frames.sent


def test_each_source_has_a_stream_of_its_own(stage: Stage) -> None:
    other = Stage()
    for each in (stage, other):
        each.source.publish_image(COMPRESSED_IMAGE, compressed_image((1, 5), b"first"))
    assert stage.frames.sent[0][0].stream != other.frames.sent[0][0].stream


def test_odometry_adds_up_the_way_and_never_goes_down(stage: Stage) -> None:
    for position in ([3, 4, 0], [3, 6, 9], [0, 2, 9], [0, 2, 9]):
        stage.source.publish_odometry(ODOMETRY, odometry(position))
    assert [message.metres for message in stage.odometry] == [0, 2, 7, 7]


def test_a_frame_has_the_metres_if_odometry_came_since_the_previous_frame(stage: Stage) -> None:
    for second, positions in enumerate(([], [[0, 0, 0]], [], [[1, 0, 0], [3, 0, 0]], [])):
        for position in positions:
            stage.source.publish_odometry(ODOMETRY, odometry(position))
        stage.source.publish_image(COMPRESSED_IMAGE, compressed_image((second, 0), b"image"))
    metres = [message.odometry_m for _, message in stage.frames.sent if message]
    assert metres == [None, 0, None, 3, None]


def test_implausible_odometry_is_refused_and_affects_nothing_else(stage: Stage) -> None:
    stage.source.publish_odometry(ODOMETRY, odometry([0, 0, 0]))
    for absurd in ([1e200, 0, 0], [0, -1e308, 0]):
        with pytest.raises(MessageError, match="too far away"):
            stage.source.publish_odometry(ODOMETRY, odometry(absurd))
    stage.source.publish_odometry(ODOMETRY, odometry([3, 4, 0]))
    assert [message.metres for message in stage.odometry] == [0, 5]


def test_images_are_spaced_by_odometry_and_the_others_counted(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stage = Stage(DistanceSampler(1.0))
    publish = stage.source.publish_image
    for second in (1, 2):
        publish(COMPRESSED_IMAGE, compressed_image((second, 0), b"too early"))
    for tenth in range(25):
        stage.source.publish_odometry(ODOMETRY, odometry([tenth / 10, 0, 0]))
        publish(COMPRESSED_IMAGE, compressed_image((3, tenth), str(tenth).encode()))
    stage.source.end()
    sent = [(header, message) for header, message in stage.frames.sent if message]
    assert [message.image for _, message in sent] == [b"0", b"10", b"20"]
    assert [message.odometry_m for _, message in sent] == [0, pytest.approx(1), pytest.approx(2)]
    assert [header.sequence for header, _ in sent] == [0, 1, 2]
    assert [header.stamp_ns for header, _ in sent] == [3_000_000_000 + n for n in (0, 10, 20)]
    assert stage.frames.sent[-1][0].stamp_ns == 3_000_000_020
    assert stage.counts == {"frames": 3, "left_out": 24}
    assert caplog.text.count("until odometry comes") == 1
