"""RecordSession what a bus carries; with real processes it is in tests/system."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from typing import cast

import cv2
import numpy as np
import pytest
from made_matches import ALL_KINDS, KNOWN, SMOOTHED, Written, stream_of

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage, MatchMessage
from placefield.bus.session import Bus
from placefield_tools.record.record_run import RecordSession
from placefield_tools.record.recorder import Recorder

KEYS = Keys("test")
PIXELS = np.zeros((16, 16, 3), np.uint8)


class StillBus:
    """A bus on which comes what a test delivers; nobody remembers anything."""

    def __init__(self) -> None:
        self._receivers: dict[str, Callable[[Received], None]] = {}
        self.dropped: dict[str, int] = defaultdict(int)

    def subscribe(
        self, key: str, receive: Callable[[Received], None], counts: Counter[str]
    ) -> None:
        self._receivers[key] = receive

    def ask(self, key: str, payload: bytes, *, timeout_s: float) -> Iterator[tuple[bytes, bytes]]:
        return iter(())

    def log_dropped(self, key: str, error: Exception) -> None:
        self.dropped[key] += 1

    def deliver(self, key: str, header: Header, payload: bytes) -> None:
        if key in self._receivers:
            self._receivers[key](Received(key, header, payload))

    def deliver_match(self, header: Header, match: MatchMessage | None) -> None:
        self.deliver(KEYS.match, header, match.encode() if match else b"")
        if match is None:
            self.deliver(KEYS.smoothed, header, b"")

    def deliver_frame(self, header: Header, image: bytes | np.ndarray = PIXELS) -> None:
        self.deliver(KEYS.frame, header, FrameMessage(image=image).encode())


class Kept:
    """A recorder that keeps what it is to write."""

    def __init__(self) -> None:
        self.matches: list[Written] = []
        self.frames: list[tuple[Header, bytes]] = []
        self.recorder = Recorder(
            lambda header, match: self.matches.append((header, match)),
            lambda header, jpeg: self.frames.append((header, jpeg)),
        )


@pytest.fixture
def bus() -> StillBus:
    return StillBus()


@pytest.fixture
def kept() -> Kept:
    return Kept()


@pytest.fixture
def recording(bus: StillBus, kept: Kept) -> RecordSession:
    return RecordSession(cast(Bus, bus), KEYS, kept.recorder, frames=True)


def drain(recording: RecordSession) -> dict[str, int]:
    while recording.write_received(0):
        pass
    return dict(recording.counts)


def test_smoothed_matches_are_written_too_and_the_end_once(
    bus: StillBus, recording: RecordSession, kept: Kept
) -> None:
    *matches, end = stream_of([KNOWN, KNOWN])
    for header, match in matches:
        bus.deliver_match(header, match)
        bus.deliver(KEYS.smoothed, header, SMOOTHED.encode())
    bus.deliver_match(*end)
    assert drain(recording) == {"matches": 2, "smoothed matches": 2}
    assert [match for _, match in kept.matches] == [KNOWN, SMOOTHED, KNOWN, SMOOTHED, None]


def test_descriptors_have_no_picture_and_are_counted(
    bus: StillBus, recording: RecordSession, kept: Kept
) -> None:
    (header, match), *_ = stream_of([KNOWN])
    bus.deliver(KEYS.frame, header, FrameMessage(descriptor=np.ones(4, np.float32)).encode())
    bus.deliver_match(header, match)
    assert drain(recording) == {"matches": 1, "descriptors, which have no picture": 1}
    assert not kept.frames


def test_every_match_of_every_stream_is_written_in_order(
    bus: StillBus, recording: RecordSession, kept: Kept
) -> None:
    streams = stream_of(ALL_KINDS, "first") + stream_of(ALL_KINDS, "second")
    for header, match in streams:
        bus.deliver_match(header, match)
    assert drain(recording) == {"matches": 8}
    assert kept.matches == streams


def test_matches_that_are_lost_or_malformed_are_counted(
    bus: StillBus, recording: RecordSession, kept: Kept
) -> None:
    stream = stream_of([KNOWN] * 6)
    bus.deliver_match(*stream[0])
    bus.deliver_match(*stream[3])
    bus.deliver(KEYS.match, stream[4][0], b"no match")
    bus.deliver_match(*stream[5])
    assert drain(recording) == {"matches": 3, "lost matches": 3, "malformed matches": 1}
    assert [header.sequence for header, _ in kept.matches] == [0, 3, 5]
    assert bus.dropped == {KEYS.match: 1}


def test_frames_are_written_once_each_with_their_own_headers(
    bus: StillBus, recording: RecordSession, kept: Kept
) -> None:
    stream = stream_of([KNOWN] * 3)
    for header, _ in [*stream[:2], *stream[:3]]:
        bus.deliver_frame(header)
    bus.deliver(KEYS.frame, stream[-1][0], b"")
    assert drain(recording) == {"frames": 3}
    assert [header for header, _ in kept.frames] == [header for header, _ in stream[:-1]]
    assert all(
        cv2.imdecode(np.frombuffer(jpeg, np.uint8), 1) is not None for _, jpeg in kept.frames
    )


def test_frames_that_cannot_be_written_are_counted_and_the_next_still_is(
    bus: StillBus, recording: RecordSession, kept: Kept
) -> None:
    stream = stream_of([KNOWN] * 6)
    bus.deliver_frame(stream[0][0], b"no picture")
    bus.deliver(KEYS.frame, stream[1][0], b"no frame")
    bus.deliver_frame(stream[5][0])
    assert drain(recording) == {
        "frames": 1,
        "unreadable frames": 1,
        "malformed frames": 1,
        "lost frames": 3,
    }


def test_matches_do_not_wait_for_pictures_and_old_live_frames_give_way_to_new(
    bus: StillBus, recording: RecordSession, kept: Kept
) -> None:
    stream = stream_of([KNOWN] * 40)
    for header, match in stream[:-1]:
        bus.deliver_frame(header.model_copy(update={"live": True}))
        bus.deliver_match(header, match)
    recording.write_received(0)
    assert len(kept.matches) == 40
    assert 1 <= len(kept.frames) <= 16
    counts = drain(recording)
    assert counts["frames"] + counts["frames too late for a picture"] == 40


def test_without_being_asked_for_no_frame_is_even_received(bus: StillBus, kept: Kept) -> None:
    recording = RecordSession(cast(Bus, bus), KEYS, kept.recorder, frames=False)
    bus.deliver_frame(stream_of([KNOWN])[0][0])
    assert drain(recording) == {}


def test_a_frame_that_gave_way_is_not_counted_as_lost_too(
    bus: StillBus, recording: RecordSession
) -> None:
    first, *others = [header for header, _ in stream_of([KNOWN] * 40)[:-1]]
    bus.deliver_frame(first.model_copy(update={"live": True}))
    recording.write_received(0)
    for header in others:
        bus.deliver_frame(header.model_copy(update={"live": True}))
    counts = drain(recording)
    assert counts["frames too late for a picture"] > 0
    assert "lost frames" not in counts
