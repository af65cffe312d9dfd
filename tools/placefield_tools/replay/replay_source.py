"""A source of frames onto the bus."""

import itertools
import logging
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from placefield.bus.credits import Credits
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys, service_and_identity
from placefield.bus.messages import FrameMessage, Header, MatchMessage, UnseenMessage
from placefield.bus.session import Bus
from placefield.config import Config
from placefield.errors import BusError, MessageError, SourceError
from placefield.features.frames import Frame
from placefield_tools.common.progress import tracked
from placefield_tools.replay.proof import Proof
from placefield_tools.sources import Source
from placefield_tools.sources.source import until

log = logging.getLogger(__name__)

_POLL_S = 0.1
_SEND_AGAIN_S = 0.5  # after the last answer, and again after twice as long, and so on
_STALLED_S = 15.0


@dataclass(frozen=True)
class Replayed:
    """What became of a replay.

    Attributes:
        sent: how many frames.
        unseen: how many of them were no image, or a blank one, to the featurizer, by which.
    """

    sent: int
    unseen: Mapping[str, int]


def replay(
    source: Source,
    bus: Bus,
    config: Config,
    stop: threading.Event,
    *,
    rate: float | None = None,
    loop: bool = False,
) -> Replayed:
    """Publish the frames of a source.

    A camera is live: what the services cannot follow is dropped. Any other source is lossless: a
    frame is sent when one before it has been answered, and the end is awaited.

    Args:
        source: of the frames.
        bus: to publish on.
        config: its run and bus.
        stop: ends the stream early.
        rate: frames per second at most, of a camera the newest; None: as fast as credits allow.
        loop: begin again at the end, in the same stream.

    Raises:
        BusError: a service is missing, another replay is on, or the services stop answering.
        SourceError: the source fails.
    """
    keys = Keys(config.run)
    with bus.sole(keys, "replay", uuid.uuid4().hex[:8]):
        _await_services(bus, keys, config.bus.connect_timeout_s, stop)
        stream = _Stream(bus, keys, live=source.live)
        frames = _frames(source, loop, stop)
        if rate is not None:
            frames = _newest(frames, rate) if source.live else stream.paced(frames, rate, stop)
        try:
            with tracked(frames, "replaying", None if loop else source.count) as in_turn:
                for frame in in_turn:
                    if not stream.send(frame, stop):
                        break
        except SourceError:
            stream.end(stop)
            if not stop.is_set():  # else it may have been cut short before its first frame
                raise
        stream.end(stop)
        return Replayed(stream.sent, stream.unseen)


class _Stream:
    """One stream of frames: numbers them and keeps to the credits."""

    def __init__(self, bus: Bus, keys: Keys, *, live: bool) -> None:
        self.sent = 0
        self.unseen: Counter[str] = Counter()
        self._last_unseen = -1
        self._has_ended = False
        self._name = uuid.uuid4().hex
        self._live = live
        self._stamp_ns = 0
        self._credits = Credits()
        self._unanswered: deque[tuple[Header, bytes]] = deque()
        self._run = keys.run
        self._publisher = bus.publisher(keys.frame)
        self._looked, self._silent_s, self._wait_s = time.monotonic(), 0.0, _SEND_AGAIN_S
        self._gone: set[str] = set()
        self._is_back = threading.Event()  # a service that was gone: what was under way is lost
        self._proof = Proof()
        self._counts: Counter[str] = Counter()
        if not live:
            bus.subscribe(keys.match, self._note_match, self._counts, in_turn=True)
        bus.subscribe(keys.ack, self._answered, self._counts, in_turn=True)
        bus.subscribe(keys.unseen, self._note_unseen, Counter())
        for service in ("featurizer", "fuser"):
            bus.watch_alive(keys.all_alive(service), self._note_life)

    def _answered(self, received: Received) -> None:
        sequence = received.header.sequence
        if received.header.stream != self._name:
            return
        if sequence > self.sent or (sequence == self.sent and not self._has_ended):
            raise MessageError(f"the answer to frame {sequence}, of {self.sent} that were sent")
        if self._live:
            self._credits.answer(sequence)
        else:
            self._believe(self._proof.claim(sequence, self.sent))

    def _note_match(self, received: Received) -> None:
        header = received.header
        if header.stream != self._name or header.end:
            return
        if header.sequence >= self.sent:
            raise MessageError(f"the match of frame {header.sequence}, of {self.sent} sent")
        MatchMessage.decode(received.payload)
        self._believe(self._proof.match(header.sequence, self.sent))

    def _believe(self, proven: int | None) -> None:
        if proven is not None:
            self._credits.answer(proven)

    def _note_unseen(self, received: Received) -> None:
        header = received.header
        is_new = self._last_unseen < header.sequence < self.sent  # else it was sent again, or never
        if header.stream == self._name and is_new:
            self.unseen[UnseenMessage.decode(received.payload).reason] += 1
            self._last_unseen = header.sequence

    def _note_life(self, key: str, is_alive: bool) -> None:
        service, _ = service_and_identity(key)
        if not is_alive:
            self._gone.add(service)
        elif service in self._gone:
            self._gone.discard(service)
            self._is_back.set()

    def paced(self, frames: Iterable[Frame], rate: float, stop: threading.Event) -> Iterator[Frame]:
        """Hand frames on at a rate of so many per second; no catching up after a wait."""
        due = time.monotonic()
        for frame in frames:
            while (wait_s := due - time.monotonic()) > 0 and not stop.is_set():
                stop.wait(min(wait_s, _POLL_S))
                self._look_after()
            due = _next_due(due, rate)
            yield frame

    def send(self, frame: Frame, stop: threading.Event) -> bool:
        """Publish a frame when there is a credit for it; False if stopped before."""
        if stop.is_set() or not (self._live or self._await(self._take_credit, stop)):
            return False
        self._look_after()
        self._stamp_ns = frame.stamp_ns
        message = FrameMessage(image=frame.image, odometry_m=frame.odometry_m)
        header = self._header()
        self.sent += 1  # before its answer may come
        self._put(header, message.encode())
        return True

    def end(self, stop: threading.Event) -> None:
        """Publish the end of the stream and wait until it is answered."""
        self._has_ended = True
        self._put(self._header(end=True), b"")
        self._await(lambda: self._credits.wait_until_answered(self.sent, _POLL_S), stop)
        if disbelieved := self._counts["malformed"] + self._proof.forged:
            log.warning(
                "run %r: %d answers or matches were not due, and counted for nothing: does "
                "somebody else publish on this run?",
                self._run,
                disbelieved,
            )
        if not self._live and self._proof.matched < self.sent:
            log.warning(
                "run %r: %d frames sent, and %d matched", self._run, self.sent, self._proof.matched
            )

    def _put(self, header: Header, payload: bytes) -> None:
        if not self._live:
            self._proof.send(header.sequence)
        self._publisher.send(header, payload)
        if header.end or not self._live:
            self._unanswered.append((header, payload))

    def _send_again(self) -> None:
        """Send what has not been answered: it, or its answer, may be lost."""
        self._is_back.clear()
        oldest = 0 if self._live else self._credits.answered
        for header, payload in self._unanswered:
            now = min(oldest, header.sequence)  # it may have been answered in the meantime
            if not self._live:
                self._proof.send(header.sequence)
            self._publisher.send(header.model_copy(update={"oldest": now}), payload)

    def _take_credit(self) -> bool:
        return self._credits.take(_POLL_S)

    def _header(self, *, end: bool = False) -> Header:
        return Header(
            stream=self._name,
            sequence=self.sent,
            stamp_ns=self._stamp_ns,
            live=self._live,
            oldest=0 if self._live else min(self._credits.answered, self.sent),
            end=end,
        )

    def _await(self, is_over: Callable[[], bool], stop: threading.Event) -> bool:
        """Poll until it is over or stopped; False if stopped.

        Raises:
            BusError: the services have answered nothing for a long time.
        """
        while not stop.is_set():
            if is_over():
                return True
            self._look_after()
        return False

    def _look_after(self) -> None:
        """Send again what has not been answered for some time, or since a service was away.

        Raises:
            BusError: the services have answered nothing for a long time.
        """
        now = time.monotonic()
        self._silent_s += min(now - self._looked, _SEND_AGAIN_S)  # a slow source is no silence
        self._looked = now
        oldest = self._unanswered[0][0].sequence if self._unanswered else None
        while self._unanswered and self._unanswered[0][0].sequence < self._credits.answered:
            self._unanswered.popleft()
        if not self._unanswered or self._unanswered[0][0].sequence != oldest:
            self._silent_s, self._wait_s = 0.0, _SEND_AGAIN_S
        if self._silent_s > _STALLED_S:
            raise self._stalled()
        if self._silent_s >= self._wait_s:
            self._wait_s *= 2
            self._send_again()
        elif self._is_back.is_set():
            self._send_again()

    def _stalled(self) -> BusError:
        return BusError(
            f"run {self._run!r}: {self.sent} frames sent, {self._credits.answered} answered, and "
            f"none for {_STALLED_S:g} s: see what 'placefield status' says of the services"
        )


def _await_services(bus: Bus, keys: Keys, timeout: float, stop: threading.Event) -> None:
    end = time.monotonic() + timeout
    while missing := [s for s in ("featurizer", "fuser") if not bus.alive(keys.all_alive(s))]:
        if time.monotonic() > end or stop.wait(_POLL_S):
            raise BusError(
                f"run {keys.run!r} has no {' and no '.join(missing)}: "
                "start the services with 'placefield up MAP'"
            )


def _frames(source: Source, loop: bool, stop: threading.Event) -> Iterator[Frame]:
    """Return the frames, once or until stopped."""
    return itertools.chain.from_iterable(
        until(stop, itertools.repeat(source)) if loop else (source,)
    )


def _newest(frames: Iterable[Frame], rate: float) -> Iterator[Frame]:
    """Hand on so many of a camera's frames per second, none late; those between are left out.

    Odometry that came with one that is left out goes with the next: it is still news.
    """
    due, odometry_m = time.monotonic(), None
    for frame in frames:
        odometry_m = odometry_m if frame.odometry_m is None else frame.odometry_m
        if time.monotonic() >= due:
            due = _next_due(due, rate)
            yield replace(frame, odometry_m=odometry_m)
            odometry_m = None


def _next_due(due: float, rate: float) -> float:
    return max(due, time.monotonic() - 1 / rate) + 1 / rate
