"""Matches off the bus."""

import logging
import queue
import time
from collections import Counter, deque
from collections.abc import Iterator

from placefield.bus.history import LENGTH, recalling
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import Header, MatchMessage
from placefield.bus.session import Bus
from placefield.bus.streams import StreamFollower, Turn
from placefield_tools.standing import other_runs

log = logging.getLogger(__name__)

_QUIET_S = 2.0

Taken = tuple[Header, MatchMessage | None]


def warn_of_other_runs(bus: Bus, run: str) -> None:
    """Log which runs there are if this one has no service: its name may be wrong."""
    if others := other_runs(run, bus.runs()):
        log.warning("run %r has no service yet; %s", run, others)


class MatchQueue:
    """The matches of a run from now on, each once.

    They come in order. In a lossless stream what was lost on the way is asked for.
    """

    def __init__(self, bus: Bus, keys: Keys) -> None:
        self.counts: Counter[str] = Counter()
        self._received: queue.SimpleQueue[Received] = queue.SimpleQueue()
        self._taken: deque[Taken] = deque()
        self._follower = StreamFollower(self.counts, lambda header: header.sequence)
        self._open_stream: str | None = None
        self._ask_at = 0.0
        self._recall = recalling(bus, keys.history(keys.match))
        bus.subscribe(keys.match, self._received.put, self.counts)

    def take(self, timeout: float) -> Taken | None:
        """Return the next match with its header, no match at the end of a stream; None: none yet.

        Raises:
            MessageError: it does not parse.
        """
        end = time.monotonic() + timeout
        while not self._taken:
            try:
                received = self._received.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                self._ask_if_quiet()
                return self._taken.popleft() if self._taken else None
            self._receive(received.header, received.payload)
            self._ask_at = time.monotonic() + _QUIET_S
        return self._taken.popleft()

    def _ask_if_quiet(self) -> None:
        """Ask for what comes next: it, and all behind it, may have been lost on the way."""
        if self._open_stream is None or time.monotonic() < self._ask_at:
            return
        self._ask_at = time.monotonic() + _QUIET_S
        first = self._follower.next
        for header, payload in self._recall(self._open_stream, first, first + LENGTH).values():
            self._receive(header, payload)

    def _receive(self, header: Header, payload: bytes) -> None:
        match = None if header.end else MatchMessage.decode(payload)
        turn = self._follower.follow(header)
        if turn is Turn.AHEAD:
            missed = [] if header.live else self._missed(header)
            self._taken += missed
            gap = header.sequence - self._follower.next
            self._follower.leap(header.sequence, gap - len(missed))
        if turn in (Turn.NEXT, Turn.AHEAD):
            self._taken.append((header, match))
            self._open_stream = None if header.end or header.live else header.stream

    def _missed(self, header: Header) -> list[Taken]:
        recalled = self._recall(header.stream, self._follower.next, header.sequence)
        return [(old, MatchMessage.decode(payload)) for old, payload in recalled.values()]


def stream_matches(matches: MatchQueue, timeout: float) -> Iterator[tuple[Header, MatchMessage]]:
    """Yield the matches that are there until the stream ends, or none comes for ``timeout`` s."""
    while (taken := matches.take(timeout)) is not None:
        header, match = taken
        if match is None:
            return
        yield header, match
