"""A run's messages from the bus, for a reader that may be slow.

The bus never waits: new messages replace old ones that were not read in time, and the lost ones are
counted.
"""

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.session import Bus
from placefield.errors import MessageError
from placefield_tools.dashboard.state import LiveState, ShownMap
from placefield_tools.status.service_status import RunStatus
from placefield_tools.status.statistics import RunListener

_MOST = 1024  # messages
_MOST_BYTES = 64 * 2**20


class Newest:
    """A queue of the newest unread messages; ``dropped`` counts the ones it had to drop."""

    def __init__(self, most: int = _MOST, most_bytes: int = _MOST_BYTES) -> None:
        self.dropped = 0
        self._most, self._most_bytes = most, most_bytes
        self._waiting: deque[Received] = deque()
        self._bytes = 0
        self._lock = threading.Lock()

    def offer(self, received: Received) -> None:
        """Add a message; the oldest ones are dropped to make room."""
        with self._lock:
            self._waiting.append(received)
            self._bytes += len(received.payload)
            while len(self._waiting) > self._most or (
                self._bytes > self._most_bytes and len(self._waiting) > 1
            ):
                self._bytes -= len(self._waiting.popleft().payload)
                self.dropped += 1

    def get_batch(self) -> list[Received]:
        """Return all unread messages, oldest first, and empty the queue."""
        with self._lock:
            batch = list(self._waiting)
            self._waiting.clear()
            self._bytes = 0
            return batch


class Feed:
    """Listens to a run, and updates the state when asked to."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        state: LiveState,
        new_versions: Callable[[], Iterable[ShownMap]] = tuple,
    ) -> None:
        """Listen to a run; ``new_versions`` returns those of the map since the last call."""
        self._new_versions = new_versions
        self.counts: Counter[str] = Counter()
        self._bus = bus
        self._state = state
        self._newest = Newest()
        self._matches: list[Received] = []
        self._listener = RunListener(bus, keys, self._count_malformed)
        self._match_key = keys.match
        self._adders = {
            keys.frame: state.add_frame,
            keys.feature: state.add_feature,
            keys.smoothed: state.add_smoothed,
        }
        bus.subscribe(keys.frame, self._receive_frame, self.counts)
        bus.subscribe(keys.feature, self._receive_feature, self.counts)
        for key in (keys.match, keys.smoothed):
            bus.subscribe(key, self._newest.offer, self.counts)
        bus.subscribe(keys.all_candidates, self._newest.offer, self.counts, ends_empty=False)

    @property
    def dropped(self) -> int:
        """How many messages were dropped because they came faster than this page reads."""
        return self._newest.dropped

    @property
    def connected(self) -> bool:
        """Whether the router answers."""
        return self._bus.connected

    def drain(self) -> None:
        """Add the messages received since to the state; count unreadable ones as ``malformed``.

        Matches are added one call later: each key has its own thread, so that a match may arrive
        before the candidates that it was made of.
        """
        for version in self._new_versions():
            self._state.offer(version)
        matches, self._matches = self._matches, []
        for received in self._newest.get_batch():
            if received.key == self._match_key:
                self._matches.append(received)
            else:
                add = self._adders.get(received.key, self._state.add_candidates)
                self._try(add, received)
        for received in matches:
            self._try(self._state.add_match, received)

    def _try(self, add: Callable[[Header, bytes], None], received: Received) -> None:
        try:
            add(received.header, received.payload)
        except MessageError as error:
            self._count_malformed(received.key, error)

    def _count_malformed(self, key: str, error: MessageError) -> None:
        self.counts["malformed"] += 1
        self._bus.log_dropped(key, error)

    def status(self) -> RunStatus:
        """Return the status of the run's services."""
        return self._listener.status()

    def _receive_frame(self, received: Received) -> None:
        self._listener.announce_sent(received)
        self._newest.offer(received)

    def _receive_feature(self, received: Received) -> None:
        self._listener.announce(received)
        self._newest.offer(received)
