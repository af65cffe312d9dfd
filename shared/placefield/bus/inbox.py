"""A bounded queue between the bus's thread and a service's.

The bus must never wait for a service: a receive thread that blocks stops everything else on its
session, and the transport with it. What does not fit is dropped and counted. Each run has its own
share of the room, so that none can take another's.
"""

import threading
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass

from placefield.bus.keys import run_of
from placefield.bus.messages import Header

CAPACITY = 4096
"""Messages of a run; above a credit window of frames and their candidates of 64 channels, so that a
lossless stream never fills it."""


@dataclass(frozen=True)
class Received:
    """A message as it came: its payload is not decoded yet."""

    key: str
    header: Header
    payload: bytes

    @property
    def run(self) -> str:
        """The run whose key it came on."""
        return run_of(self.key)


class Inbox:
    """What was received and not yet handled, oldest first."""

    def __init__(
        self, counts: Mapping[str, Counter[str]], *, live_capacity: int = CAPACITY
    ) -> None:
        """Serve the runs that have ``counts``; keep ``live_capacity`` live messages of each."""
        self._counts = counts
        self._live_capacity = live_capacity
        self._waiting: deque[Received] = deque()
        self._held: Counter[str] = Counter()  # of each run
        self._live: Counter[str] = Counter()  # of these, what may be dropped
        self._changed = threading.Condition()

    def offer(self, received: Received) -> None:
        """Put a message in; an older live one makes room for a live one, nothing does for others.

        What does not fit is dropped. A lossless stream and the end of any are never displaced.
        """
        run, may_be_dropped = received.run, _may_be_dropped(received)
        with self._changed:
            if may_be_dropped and self._live[run] >= self._live_capacity:
                self._drop_oldest(run)
            if self._held[run] >= CAPACITY:
                self._counts[run]["dropped_full"] += 1
                return
            self._waiting.append(received)
            self._held[run] += 1
            self._live[run] += may_be_dropped
            self._changed.notify()

    def _drop_oldest(self, run: str) -> None:
        for place, waiting in enumerate(self._waiting):
            if waiting.run == run and _may_be_dropped(waiting):
                del self._waiting[place]
                break
        self._held[run] -= 1
        self._live[run] -= 1
        self._counts[run]["dropped_old"] += 1

    def take_all(self, timeout: float, limit: int) -> list[Received]:
        """Take what waits, the oldest ``limit`` at most; empty if none comes in ``timeout`` s."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting, timeout)
            taken = [self._waiting.popleft() for _ in range(min(limit, len(self._waiting)))]
            for received in taken:
                self._held[received.run] -= 1
                self._live[received.run] -= _may_be_dropped(received)
        return taken


def _may_be_dropped(received: Received) -> bool:
    return received.header.live and not received.header.end
