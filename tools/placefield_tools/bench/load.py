"""Live cameras that publish frames at a rate, and how long their matches take."""

import threading
import time
import uuid
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage, MatchMessage
from placefield.bus.session import Bus
from placefield.errors import BusError

_LAST_MATCH_S = 10.0


@dataclass(frozen=True)
class Answers:
    """What became of the frames of one camera, or of several.

    Attributes:
        sent: how many were published.
        latencies: seconds from a frame's publication to its match, of those that all channels
            answered, float64.
    """

    sent: int
    latencies: NDArray[np.float64]

    @property
    def lost(self) -> int:
        """How many were not answered by all channels."""
        return self.sent - len(self.latencies)


class LiveCamera:
    """The camera of a run: publishes frames as a live stream and notes when they are answered."""

    def __init__(self, bus: Bus, run: str) -> None:
        keys = Keys(run)
        self._publisher = bus.publisher(keys.frame)
        self._begin()
        bus.subscribe(keys.match, self._answer, Counter())

    def _begin(self) -> None:
        self._stream = uuid.uuid4().hex
        self._sent: list[float] = []
        self._answered: dict[int, tuple[float, bytes]] = {}
        self._ended = threading.Event()

    def _answer(self, received: Received) -> None:
        if received.header.stream != self._stream:
            return
        if received.header.end:
            self._ended.set()
        else:
            self._answered[received.header.sequence] = (time.perf_counter(), received.payload)

    def send(self, image: bytes) -> None:
        """Publish the next frame."""
        header = self._header()
        self._sent.append(time.perf_counter())
        self._publisher.put(header, FrameMessage(image=image))

    def end(self) -> None:
        """Publish the end of the stream."""
        self._publisher.put(self._header(end=True))

    def answers(self) -> Answers:
        """Wait for the stream's end, return what was answered, and be ready for the next one."""
        self._ended.wait(_LAST_MATCH_S)
        latencies = [
            at - self._sent[sequence]
            for sequence, (at, payload) in sorted(self._answered.items())
            if not MatchMessage.decode(payload).missing
        ]
        answers = Answers(len(self._sent), np.array(latencies))
        self._begin()
        return answers

    def _header(self, *, end: bool = False) -> Header:
        return Header(
            stream=self._stream,
            sequence=len(self._sent),
            stamp_ns=time.time_ns(),
            live=True,
            end=end,
        )


def play(
    cameras: Sequence[LiveCamera], frames: Sequence[bytes], *, rate: float, seconds: float
) -> Answers:
    """Return what ``play_each`` does, of all cameras together.

    Raises:
        BusError: not one of them was answered by all channels.
    """
    answers = play_each(cameras, frames, rate=rate, seconds=seconds)
    latencies = np.concatenate([each.latencies for each in answers])
    if not len(latencies):
        raise BusError(f"none of {sum(each.sent for each in answers)} frames was answered in full")
    return Answers(sum(each.sent for each in answers), latencies)


def play_each(
    cameras: Sequence[LiveCamera], frames: Sequence[bytes], *, rate: float, seconds: float
) -> list[Answers]:
    """Let all cameras publish at a rate for so long, taking turns, each along another part.

    Args:
        cameras: of which each sends ``rate`` frames a second.
        frames: of one route; they begin again at the end.
        rate: frames per second and camera.
        seconds: how long.

    Returns:
        What became of the frames of each camera.
    """
    apart = len(frames) // len(cameras)
    start = time.perf_counter()
    for turn in range(round(rate * seconds)):
        for number, camera in enumerate(cameras):
            due = start + (turn + number / len(cameras)) / rate
            time.sleep(max(0.0, due - time.perf_counter()))
            camera.send(frames[(turn + number * apart) % len(frames)])
    for camera in cameras:
        camera.end()
    return [camera.answers() for camera in cameras]
