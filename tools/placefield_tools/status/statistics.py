"""What the services of a run say of themselves, off the bus."""

import threading
import time
from collections import Counter
from collections.abc import Callable

from placefield.bus.inbox import Received
from placefield.bus.keys import EVERY_TOKEN, Keys, run_of, service_and_identity
from placefield.bus.messages import StatsMessage
from placefield.bus.session import LONGEST_STATS, MOST_TOKENS, Bus
from placefield.errors import MessageError
from placefield_tools.status.service_status import RunRecord, RunStanding, process_of


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
        if not is_alive:
            self._tokens.discard(key)
        elif len(self._tokens) < 16 * MOST_TOKENS:  # of all runs
            self._tokens.add(key)


class RunListener:
    """Keeps a record of what a run's services say, from now on, and of who of them is alive.

    Who says something and has no token is no service.
    """

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
        self._processes: Counter[tuple[str, str]] = Counter()
        """How many tokens each has."""
        self._lock = threading.Lock()
        self._tokens_left_out = 0
        self._strangers: Counter[tuple[str, str]] = Counter()
        bus.watch_alive(keys.all_alive(), self._note_life)
        bus.subscribe_raw(keys.all_stats, self._tell)

    def announce(self, received: Received) -> None:
        """Take a descriptor's message: it says which frame is the newest."""
        with self._lock:
            self._record.announce(received.header)

    def standing(self) -> RunStanding:
        """Say how the services stand."""
        with self._lock:
            return self._record.standing(tuple(self._tokens), time.monotonic())

    @property
    def left_out(self) -> int:
        """How many tokens were beyond so many that no more are real, and how many strangers told.

        One that has told once may be a service whose token is on its way.
        """
        return self._tokens_left_out + sum(count > 1 for count in self._strangers.copy().values())

    def _tell(self, key: str, payload: bytes) -> None:
        process = service_and_identity(key)
        try:
            if len(payload) > LONGEST_STATS:
                raise MessageError(f"{len(payload)} bytes of counts, more than {LONGEST_STATS}")
            stats = StatsMessage.decode(payload)
        except MessageError as error:
            self._on_malformed(key, error)
            return
        with self._lock:
            if process in self._processes:
                self._record.tell(*process, stats, time.monotonic())
            elif process in self._strangers or len(self._strangers) < MOST_TOKENS:
                self._strangers[process] += 1

    def _note_life(self, key: str, is_alive: bool) -> None:
        process = process_of(*service_and_identity(key))
        with self._lock:
            if is_alive == (key in self._tokens):
                return
            if not is_alive:
                self._tokens.discard(key)
                self._processes[process] -= 1
                if not self._processes[process]:
                    del self._processes[process]
                    self._record.forget(*process)
            elif len(self._tokens) < MOST_TOKENS:
                self._tokens.add(key)
                self._processes[process] += 1
            else:
                self._tokens_left_out += 1
