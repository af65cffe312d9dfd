"""How a source publishes the frames of one stream."""

import logging
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from placefield.bus.credits import Credits
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys, service_and_identity
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage, MatchMessage, MissingObservationMessage
from placefield.bus.proof import Proof
from placefield.bus.session import Bus
from placefield.errors import BusError, MessageError
from placefield.features.frames import Frame

log = logging.getLogger(__name__)

_POLL_S = 0.1
_SEND_AGAIN_S = 0.5  # after the last answer; each further wait is twice as long
_STALLED_S = 15.0


@contextmanager
def sending(
    bus: Bus, keys: Keys, stop: threading.Event, *, live: bool, patience_s: float
) -> Iterator["FrameStream"]:
    """Wait for the services of a run, and begin a stream as its only source inside the block.

    Args:
        bus: the session to publish on.
        keys: of the run.
        stop: ends the wait for the services.
        live: whether the services may drop frames when they are too slow. If not, a frame is sent
            only when enough earlier frames have been answered.
        patience_s: how long to wait for the services, seconds.

    Raises:
        BusError: a service is missing, or the run has another source.
    """
    with bus.sole(keys, "replay", uuid.uuid4().hex[:8]):
        _await_services(bus, keys, patience_s, stop)
        yield FrameStream(bus, keys, live=live)


class FrameStream:
    """One stream of frames: it numbers the frames and waits for credits.

    Attributes:
        name: of the stream.
        sent: how many frames were sent.
        unobserved: how many of them the featurizer could not observe, by reason: ``unreadable`` or
            ``blank``.
        has_ended: whether the end was sent.
        has_stalled: whether the stream gave up because the services did not answer for too long.
    """

    def __init__(self, bus: Bus, keys: Keys, *, live: bool) -> None:
        self.sent = 0
        self.unobserved: Counter[str] = Counter()
        self._last_unobserved = -1
        self.has_ended = False
        self.has_stalled = False
        self.name = uuid.uuid4().hex
        self._live = live
        self._stamp_ns = 0
        self._credits = Credits()
        self._unanswered: deque[tuple[Header, bytes]] = deque()
        self._run = keys.run
        self._publisher = bus.publisher(keys.frame)
        self._looked, self._silent_s, self._wait_s = time.monotonic(), 0.0, _SEND_AGAIN_S
        self._gone: set[str] = set()
        self._is_back = threading.Event()  # a service restarted: the frames under way are lost
        self._proof = Proof()
        self._counts: Counter[str] = Counter()
        if not live:
            bus.subscribe(keys.match, self._note_match, self._counts, in_turn=True)
        bus.subscribe(keys.ack, self._answered, self._counts, in_turn=True)
        bus.subscribe(keys.unobserved, self._note_unobserved, Counter())
        for service in ("featurizer", "fuser"):
            bus.watch_alive(keys.all_alive(service), self._note_life)

    def _answered(self, received: Received) -> None:
        sequence = received.header.sequence
        if received.header.stream != self.name:
            return
        if sequence > self.sent or (sequence == self.sent and not self.has_ended):
            raise MessageError(f"an answer to frame {sequence}, but {self.sent} frames were sent")
        if self._live:
            self._credits.answer(sequence)
        else:
            self._acknowledge(self._proof.claim(sequence, self.sent))

    def _note_match(self, received: Received) -> None:
        header = received.header
        if header.stream != self.name or header.end:
            return
        if header.sequence >= self.sent:
            raise MessageError(
                f"a match of frame {header.sequence}, but {self.sent} frames were sent"
            )
        MatchMessage.decode(received.payload)
        self._acknowledge(self._proof.match(header.sequence, self.sent))

    def _acknowledge(self, proven: int | None) -> None:
        if proven is not None:
            self._credits.answer(proven)

    def _note_unobserved(self, received: Received) -> None:
        header = received.header
        # Other frames were sent again, or never sent.
        is_new = self._last_unobserved < header.sequence < self.sent
        if header.stream == self.name and is_new:
            self.unobserved[MissingObservationMessage.decode(received.payload).reason] += 1
            self._last_unobserved = header.sequence

    def _note_life(self, key: str, is_alive: bool) -> None:
        service, _ = service_and_identity(key)
        if not is_alive:
            self._gone.add(service)
        elif service in self._gone:
            self._gone.discard(service)
            self._is_back.set()

    def send(self, frame: Frame, stop: threading.Event) -> bool:
        """Publish a frame as soon as there is a credit; False if stopped before."""
        if stop.is_set() or not (self._live or self._await(self._acquire_credit, stop)):
            return False
        self.look_after()
        self._stamp_ns = frame.stamp_ns
        message = _message(frame)
        header = self._header()
        self.sent += 1  # before the answer can come
        self._put(header, message.encode())
        return True

    def end(self, stop: threading.Event) -> None:
        """Publish the end of the stream, and wait until the services have answered it."""
        self.has_ended = True
        self._put(self._header(end=True), b"")
        self._await(lambda: self._credits.wait_until_answered(self.sent, _POLL_S), stop)
        if not_due := self._counts["malformed"] + self._proof.forged:
            log.warning(
                "run %r: %d answers or matches were not due and were ignored; check whether "
                "another client publishes on this run",
                self._run,
                not_due,
            )
        if not self._live and self._proof.matched < self.sent:
            log.warning(
                "run %r: %d frames sent, but %d matched", self._run, self.sent, self._proof.matched
            )

    def _put(self, header: Header, payload: bytes) -> None:
        self._publish(header, payload)
        if header.end or not self._live:
            self._unanswered.append((header, payload))

    def _send_again(self) -> None:
        """Send all unanswered frames again: the frame or its answer may be lost."""
        self._is_back.clear()
        oldest = 0 if self._live else self._credits.answered
        for header, payload in self._unanswered:
            now = min(oldest, header.sequence)  # the frame may have been answered meanwhile
            self._publish(header.model_copy(update={"oldest": now}), payload)

    def _publish(self, header: Header, payload: bytes) -> None:
        if not self._live:  # a live stream needs no proof
            self._proof.send(header.sequence)
        self._publisher.send(header, payload)

    def _acquire_credit(self) -> bool:
        return self._credits.acquire(_POLL_S)

    def _header(self, *, end: bool = False) -> Header:
        return Header(
            stream=self.name,
            sequence=self.sent,
            stamp_ns=self._stamp_ns,
            live=self._live,
            oldest=0 if self._live else min(self._credits.answered, self.sent),
            end=end,
        )

    def _await(self, is_over: Callable[[], bool], stop: threading.Event) -> bool:
        """Poll until ``is_over`` or stopped; False if stopped.

        Raises:
            BusError: the services have answered nothing for 15 s.
        """
        while not stop.is_set():
            if is_over():
                return True
            self.look_after()
        return False

    def look_after(self) -> None:
        """Send unanswered frames again, after some silence or after a service restarted.

        Raises:
            BusError: the services have answered nothing for 15 s.
        """
        now = time.monotonic()
        self._silent_s += min(
            now - self._looked, _SEND_AGAIN_S
        )  # a slow source is not counted as silence
        self._looked = now
        oldest = self._unanswered[0][0].sequence if self._unanswered else None
        while self._unanswered and self._unanswered[0][0].sequence < self._credits.answered:
            self._unanswered.popleft()
        if not self._unanswered or self._unanswered[0][0].sequence != oldest:
            self._silent_s, self._wait_s = 0.0, _SEND_AGAIN_S
        if self._silent_s > _STALLED_S:
            self.has_stalled = True
            raise self._stalled()
        if self._silent_s >= self._wait_s:
            self._wait_s *= 2
            self._send_again()
        elif self._is_back.is_set():
            self._send_again()

    def _stalled(self) -> BusError:
        return BusError(
            f"run {self._run!r}: {self.sent} frames sent, {self._credits.answered} answered, and "
            f"none for {_STALLED_S:g} s; check the services with 'placefield status'"
        )


def _message(frame: Frame) -> FrameMessage:
    if frame.descriptor is None:
        return FrameMessage(
            image=frame.image, odometry_m=frame.odometry_m, calibration=frame.calibration
        )
    return FrameMessage(descriptor=frame.descriptor, odometry_m=frame.odometry_m)


def _await_services(bus: Bus, keys: Keys, timeout: float, stop: threading.Event) -> None:
    end = time.monotonic() + timeout
    while missing := [s for s in ("featurizer", "fuser") if not bus.alive(keys.all_alive(s))]:
        if time.monotonic() > end or stop.wait(_POLL_S):
            raise BusError(
                f"run {keys.run!r} has no {' and no '.join(missing)}: "
                "start the services with 'placefield up MAP'"
            )
