"""A bounded queue between the bus's thread and a service's.

The bus must never wait for a service: a receive thread that blocks stops everything else on its
session, and the transport with it. What does not fit is dropped and counted.
"""

import threading
from collections import Counter, deque
from dataclasses import dataclass

from placefield.bus.messages import Header

CAPACITY = 1024
"""Messages; well above any credit window, so that a lossless stream never fills it."""


@dataclass(frozen=True)
class Received:
    """A message as it came: its payload is not decoded yet."""

    key: str
    header: Header
    payload: bytes


class Inbox:
    """What was received and not yet handled, oldest first."""

    def __init__(self, counts: Counter[str], *, live_capacity: int = CAPACITY) -> None:
        """Count into ``counts``; keep at most ``live_capacity`` messages of a live stream."""
        self._counts = counts
        self._live_capacity = live_capacity
        self._waiting: deque[Received] = deque()
        self._changed = threading.Condition()

    def offer(self, received: Received) -> None:
        """Put a message in; older live ones make room for a live one, nothing does for others.

        What does not fit is dropped. A lossless stream and the end of any are never displaced.
        """
        with self._changed:
            if _may_be_dropped(received.header):
                self._drop_old()
            if len(self._waiting) >= CAPACITY:
                self._counts["dropped_full"] += 1
                return
            self._waiting.append(received)
            self._changed.notify()

    def _drop_old(self) -> None:
        while len(self._waiting) >= self._live_capacity and _may_be_dropped(
            self._waiting[0].header
        ):
            self._waiting.popleft()
            self._counts["dropped_old"] += 1

    def take(self, timeout: float) -> Received | None:
        """Take the oldest message out; None if none comes within ``timeout`` seconds."""
        with self._changed:
            if not self._waiting:
                self._changed.wait(timeout)
            return self._waiting.popleft() if self._waiting else None


def _may_be_dropped(header: Header) -> bool:
    return header.live and not header.end
