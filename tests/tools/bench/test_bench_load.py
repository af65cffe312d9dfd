"""Cameras that publish at a rate, on a bus that answers as it likes."""

from collections import Counter
from collections.abc import Callable
from typing import cast

import pytest

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header, Message
from placefield.bus.messages import FrameMessage, MatchMessage
from placefield.bus.session import Bus
from placefield.errors import BusError
from placefield.maps.digest import NO_DIGEST
from placefield_tools.bench.load import LiveCamera, play


class AnsweringBus:
    """Answers every frame at once: odd ones without a channel, each fifth not at all."""

    def __init__(self) -> None:
        self.images: dict[str, list[bytes]] = {}
        self.headers: list[Header] = []
        self._answer: dict[str, Callable[[Received], None]] = {}

    def subscribe(
        self, key: str, receive: Callable[[Received], None], counts: Counter[str]
    ) -> None:
        self._answer[key] = receive

    def publisher(self, key: str) -> "AnsweringPublisher":
        return AnsweringPublisher(self, key)

    def take(self, key: str, header: Header, message: Message | None) -> None:
        run = key.split("/")[1]
        self.headers.append(header)
        if isinstance(message, FrameMessage) and isinstance(message.image, bytes):
            self.images.setdefault(run, []).append(message.image)
        if not header.end and header.sequence % 5 == 0:
            return
        missing = (1,) if header.sequence % 2 else ()
        match = (
            b""
            if header.end
            else MatchMessage(map=NO_DIGEST, place=0, score=0.0, missing=missing).encode()
        )
        self._answer[Keys(run).match](Received(Keys(run).match, header, match))


class AnsweringPublisher:
    def __init__(self, bus: AnsweringBus, key: str) -> None:
        self._bus, self._key = bus, key

    def put(self, header: Header, message: Message | None = None) -> None:
        self._bus.take(self._key, header, message)


def test_frames_without_an_answer_of_all_channels_are_lost() -> None:
    bus = AnsweringBus()
    camera = LiveCamera(cast(Bus, bus), "front")
    answers = play([camera], [b"frame"], rate=1000, seconds=0.02)
    assert answers.sent == 20
    assert len(answers.latencies) == 8  # 2, 4, 6, 8, 12, 14, 16, 18
    assert answers.lost == 12
    assert (answers.latencies >= 0).all()


def test_cameras_take_turns_along_different_parts_of_the_route() -> None:
    bus = AnsweringBus()
    cameras = [LiveCamera(cast(Bus, bus), run) for run in ("front", "rear")]
    frames = [bytes([number]) for number in range(4)]
    answers = play(cameras, frames, rate=1000, seconds=0.006)
    assert answers.sent == 12
    assert b"".join(bus.images["front"]) == bytes([0, 1, 2, 3, 0, 1])
    assert b"".join(bus.images["rear"]) == bytes([2, 3, 0, 1, 2, 3])


def test_every_play_is_a_live_stream_of_its_own() -> None:
    bus = AnsweringBus()
    camera = LiveCamera(cast(Bus, bus), "front")
    for _ in range(2):
        play([camera], [b"frame"], rate=1000, seconds=0.003)
    assert all(header.live for header in bus.headers)
    assert len({header.stream for header in bus.headers}) == 2
    assert [header.sequence for header in bus.headers] == [0, 1, 2, 3] * 2
    assert [header.end for header in bus.headers] == [False, False, False, True] * 2


def test_cameras_that_get_no_answer_at_all_are_reported_so() -> None:
    camera = LiveCamera(cast(Bus, AnsweringBus()), "front")
    with pytest.raises(BusError, match="none of 2 frames"):
        play([camera], [b"frame"], rate=1000, seconds=0.002)
