"""Matches off the bus."""

import queue
from collections import Counter
from collections.abc import Iterator

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import Header, MatchMessage
from placefield.bus.session import Bus


class MatchQueue:
    """The matches of a run from now on, in the order in which they come."""

    def __init__(self, bus: Bus, keys: Keys) -> None:
        self.counts: Counter[str] = Counter()
        self._received: queue.SimpleQueue[Received] = queue.SimpleQueue()
        bus.subscribe(keys.match, self._received.put, self.counts)

    def take(self, timeout: float) -> tuple[Header, MatchMessage | None] | None:
        """Return the next match with its header, no match at the end of a stream; None: none yet.

        Raises:
            MessageError: it does not parse.
        """
        try:
            received = self._received.get(timeout=timeout)
        except queue.Empty:
            return None
        if received.header.end:
            return received.header, None
        return received.header, MatchMessage.decode(received.payload)


def stream_matches(matches: MatchQueue, timeout: float) -> Iterator[tuple[Header, MatchMessage]]:
    """Yield the matches that are there until the stream ends, or none comes for ``timeout`` s."""
    while (taken := matches.take(timeout)) is not None:
        header, match = taken
        if match is None:
            return
        yield header, match
