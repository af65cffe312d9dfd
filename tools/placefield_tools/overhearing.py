"""What the services of a run say of themselves, off the bus."""

import threading
import time
from collections.abc import Callable

from placefield.bus.inbox import Received
from placefield.bus.keys import EVERY_TOKEN, Keys, run_of, service_and_identity
from placefield.bus.messages import StatsMessage
from placefield.bus.session import Bus
from placefield.errors import MessageError
from placefield_tools.standing import RunRecord, RunStanding


class RunsListener:
    """Keeps a record of which runs have a living service, from now on."""

    def __init__(self, bus: Bus) -> None:
        self._tokens: set[str] = set()
        bus.watch_alive(EVERY_TOKEN, self._note_life)

    @property
    def runs(self) -> set[str]:
        """The runs that have one now."""
        return {run_of(token) for token in tuple(self._tokens)}

    def _note_life(self, key: str, is_alive: bool) -> None:
        (self._tokens.add if is_alive else self._tokens.discard)(key)


class RunListener:
    """Keeps a record of what a run's services say, from now on, and of who of them is alive."""

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        on_malformed: Callable[[str, MessageError], None],
        digest: str | None = None,
    ) -> None:
        """Listen; what does not parse is told by its key, on the bus's thread.

        ``digest`` is that of the map which the services should have; None: the fuser's.
        """
        self._on_malformed = on_malformed
        self._record = RunRecord(digest)
        self._tokens: set[str] = set()
        self._lock = threading.Lock()
        bus.subscribe_raw(keys.all_stats, self._tell)
        bus.watch_alive(keys.all_alive(), self._note_life)

    def announce(self, received: Received) -> None:
        """Take a descriptor's message: it says which frame is the newest."""
        with self._lock:
            self._record.announce(received.header)

    def standing(self) -> RunStanding:
        """Say how the services stand."""
        with self._lock:
            return self._record.standing(tuple(self._tokens), time.monotonic())

    def _tell(self, key: str, payload: bytes) -> None:
        try:
            stats = StatsMessage.decode(payload)
        except MessageError as error:
            self._on_malformed(key, error)
            return
        with self._lock:
            self._record.tell(*service_and_identity(key), stats, time.monotonic())

    def _note_life(self, key: str, is_alive: bool) -> None:
        with self._lock:
            (self._tokens.add if is_alive else self._tokens.discard)(key)
