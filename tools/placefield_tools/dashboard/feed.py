"""A run's messages off the bus, for who may be slow.

The bus never waits: what is not taken in time makes room for what is newer, and is counted.
"""

import threading
from collections import Counter, deque
from collections.abc import Callable

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.session import Bus
from placefield.errors import MessageError
from placefield_tools.dashboard.state import LiveState
from placefield_tools.status.service_status import RunStanding
from placefield_tools.status.statistics import RunListener

_MOST = 1024  # messages
_MOST_BYTES = 64 * 2**20


class Newest:
    """What was received last and not taken yet; ``dropped`` says how much had to go."""

    def __init__(self, most: int = _MOST, most_bytes: int = _MOST_BYTES) -> None:
        self.dropped = 0
        self._most, self._most_bytes = most, most_bytes
        self._waiting: deque[Received] = deque()
        self._bytes = 0
        self._lock = threading.Lock()

    def offer(self, received: Received) -> None:
        """Put a message in; the oldest make room for it."""
        with self._lock:
            self._waiting.append(received)
            self._bytes += len(received.payload)
            while len(self._waiting) > self._most or (
                self._bytes > self._most_bytes and len(self._waiting) > 1
            ):
                self._bytes -= len(self._waiting.popleft().payload)
                self.dropped += 1

    def get_batch(self) -> list[Received]:
        """Take what waits, oldest first."""
        with self._lock:
            taken = list(self._waiting)
            self._waiting.clear()
            self._bytes = 0
            return taken


class Feed:
    """Hears a run, and tells the state of it when asked to."""

    def __init__(self, bus: Bus, keys: Keys, state: LiveState) -> None:
        self.counts: Counter[str] = Counter()
        self._bus = bus
        self._state = state
        self._newest = Newest()
        self._matches: list[Received] = []
        self._listener = RunListener(bus, keys, self._count_malformed, state.digest)
        self._match_key = keys.match
        self._take = {
            keys.frame: state.take_frame,
            keys.feature: state.take_feature,
            keys.smoothed: state.take_smoothed,
        }
        bus.subscribe(keys.feature, self._hear_feature, self.counts)
        for key in (keys.frame, keys.match, keys.smoothed):
            bus.subscribe(key, self._newest.offer, self.counts)
        bus.subscribe(keys.all_candidates, self._newest.offer, self.counts, ends_empty=False)

    @property
    def dropped(self) -> int:
        """How many messages came faster than they were taken."""
        return self._newest.dropped

    def drain(self) -> None:
        """Tell the state what came since; what does not parse is counted as ``malformed``.

        Matches are told a turn later: each key has a thread of its own, and what a match was made
        of may come after it.
        """
        matches, self._matches = self._matches, []
        for received in self._newest.get_batch():
            if received.key == self._match_key:
                self._matches.append(received)
            else:
                take = self._take.get(received.key, self._state.take_candidates)
                self._try(take, received)
        for received in matches:
            self._try(self._state.take_match, received)

    def _try(self, take: Callable[[Header, bytes], None], received: Received) -> None:
        try:
            take(received.header, received.payload)
        except MessageError as error:
            self._count_malformed(received.key, error)

    def _count_malformed(self, key: str, error: MessageError) -> None:
        self.counts["malformed"] += 1
        self._bus.log_dropped(key, error)

    def standing(self) -> RunStanding:
        """Say how the services of the run stand."""
        return self._listener.standing()

    def _hear_feature(self, received: Received) -> None:
        self._listener.announce(received)
        self._newest.offer(received)
