"""Candidates that came before the descriptor that begins their stream."""

from collections import Counter, deque

from placefield.bus.inbox import Received

_MOST = 256
_MOST_BYTES = 2**28


class HeldCandidates:
    """Holds messages of channel workers for a stream that has not begun; the oldest make room."""

    def __init__(self, counts: Counter[str]) -> None:
        """Count what is dropped as ``dropped_full``."""
        self._counts = counts
        self._held: deque[Received] = deque()

    def hold(self, received: Received) -> None:
        """Hold a message."""
        self._held.append(received)
        size = sum(len(each.payload) for each in self._held)
        while len(self._held) > _MOST or size > _MOST_BYTES:
            size -= len(self._held.popleft().payload)
            self._counts["dropped_full"] += 1

    def pop_all(self) -> list[Received]:
        """Return all that is held, in order, and hold it no more."""
        held = list(self._held)
        self._held.clear()
        return held
