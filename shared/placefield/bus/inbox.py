"""A bounded queue between the thread of the bus and the thread of a service.

The bus must never wait for a service: a blocked receive thread stops everything else on its
session, and the transport with it. Messages that do not fit are dropped and counted. Each run has
its own limits, so that no run can displace another.
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from placefield.bus.keys import run_of
from placefield.bus.message import Header

CAPACITY = 4096
"""The most messages of a run. That is more than a credit window of frames with the candidates of 64
workers, so that a lossless stream never fills the queue."""

CAPACITY_BYTES = 2**30
"""The most bytes of a run's messages, the last message not counted. That is more than a credit
window of frames of 32 MB."""


@dataclass(frozen=True)
class Received:
    """A received message; its payload is not decoded yet."""

    key: str
    header: Header
    payload: bytes

    @property
    def run(self) -> str:
        """The run of the message's key."""
        return run_of(self.key)


class Inbox:
    """A queue of received messages: each run's oldest first, the runs in turn."""

    def __init__(
        self,
        counts: Mapping[str, Counter[str]],
        *,
        live_capacity: int = CAPACITY,
        keeps: Callable[[Received], bool] = lambda received: False,
    ) -> None:
        """Serve the runs in ``counts``; keep at most ``live_capacity`` live messages of each.

        Live messages for which ``keeps`` is true are kept besides. It is called on any thread, and
        must not call the inbox.
        """
        self._counts = counts
        self._live_capacity = live_capacity
        self._keeps = keeps
        self._waiting: dict[str, deque[Received]] = {run: deque() for run in counts}
        self._bytes = dict.fromkeys(counts, 0)
        self._turns = deque(counts)  # the first run is the next to be served
        self._held_until = dict.fromkeys(counts, 0.0)
        self._released: set[str] = set()  # since their last message was got
        self._changed = threading.Condition()

    def offer(self, received: Received) -> None:
        """Add a message to its run's queue, or drop it if the queue is full.

        A live message displaces the oldest live one if there are too many. Messages of a lossless
        stream and the end of any stream are never displaced.
        """
        run = received.run
        with self._changed:
            waiting = self._waiting[run]
            if self._may_be_dropped(received):
                self._make_room(waiting, run)
            if len(waiting) >= CAPACITY or self._bytes[run] >= CAPACITY_BYTES:
                self._counts[run]["dropped_full"] += 1
                return
            waiting.append(received)
            self._bytes[run] += len(received.payload)
            self._changed.notify()

    def _make_room(self, waiting: deque[Received], run: str) -> None:
        live = [place for place, old in enumerate(waiting) if self._may_be_dropped(old)]
        too_many = max(0, len(live) + 1 - self._live_capacity)
        for place in reversed(live[:too_many]):
            self._bytes[run] -= len(waiting[place].payload)
            del waiting[place]
            self._counts[run]["dropped_old"] += 1

    def _may_be_dropped(self, received: Received) -> bool:
        return received.header.live and not received.header.end and not self._keeps(received)

    def put_back(self, received: Sequence[Received], wait_s: float) -> None:
        """Put messages back at the front of their run, and do not serve the run for ``wait_s``.

        The messages must be the last ones got from this run, in order. If the run was released
        after they were got, it does not wait.
        """
        with self._changed:
            run = received[0].run
            self._waiting[run].extendleft(reversed(received))
            self._bytes[run] += sum(len(each.payload) for each in received)
            self._held_until[run] = 0.0 if run in self._released else time.monotonic() + wait_s

    def release(self, run: str) -> None:
        """Serve a run again at once, since what its messages waited for has come."""
        with self._changed:
            self._released.add(run)
            self._held_until[run] = 0.0
            self._changed.notify()

    @property
    def is_waiting(self) -> bool:
        """Whether a run has a message and may be served now."""
        return any(map(self._has_turn, self._turns))

    def _has_turn(self, run: str) -> bool:
        return bool(self._waiting[run]) and self._held_until[run] <= time.monotonic()

    def get_batch(self, timeout: float, limit: int) -> list[Received]:
        """Return the waiting messages, ``limit`` at most; [] if none comes within ``timeout`` s."""
        with self._changed:
            now = time.monotonic()
            ends = [end - now for end in self._held_until.values() if end > now]
            self._changed.wait_for(lambda: self.is_waiting, min([timeout, *ends]))
            # Decide once which runs may be served, so that the whole batch sees the same runs.
            there = {run for run in self._turns if self._has_turn(run)}
            held = sum(len(self._waiting[run]) for run in there)
            return [self._pop(there) for _ in range(min(limit, held))]

    def _pop(self, runs: set[str]) -> Received:
        """Remove and return the oldest message of the next of these runs that has one."""
        while self._turns[0] not in runs or not self._waiting[self._turns[0]]:
            self._turns.rotate(-1)
        run = self._turns[0]
        self._turns.rotate(-1)
        self._released.discard(run)
        received = self._waiting[run].popleft()
        self._bytes[run] -= len(received.payload)
        return received
