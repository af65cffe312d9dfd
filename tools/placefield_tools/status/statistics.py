"""Listens on the bus for the counts of a run's services."""

import threading
import time
from collections import Counter
from collections.abc import Callable

from placefield.bus.inbox import Received
from placefield.bus.keys import EVERY_TOKEN, Keys, run_of, service_and_identity
from placefield.bus.messages import StatsMessage
from placefield.bus.session import LONGEST_STATS, MOST_TOKENS, Bus
from placefield.errors import MessageError
from placefield_tools.status.service_status import RunRecord, RunStatus, process_of


class RunsListener:
    """Keeps the set of runs that have a living service."""

    def __init__(self, bus: Bus) -> None:
        self._tokens: set[str] = set()
        bus.watch_alive(EVERY_TOKEN, self._note_life)

    @property
    def runs(self) -> set[str]:
        """The runs that have a living service now."""
        return {run_of(token) for token in tuple(self._tokens)}

    def _note_life(self, key: str, is_alive: bool) -> None:
        if not is_alive:
            self._tokens.discard(key)
        elif len(self._tokens) < 16 * MOST_TOKENS:  # of all runs
            self._tokens.add(key)


class RunListener:
    """Keeps the reports of a run's services, and which of them are alive.

    A sender without a liveliness token is not a service, and its reports are left out.
    """

    def __init__(
        self, bus: Bus, keys: Keys, on_malformed: Callable[[str, MessageError], None]
    ) -> None:
        """Start to listen.

        Args:
            bus: the bus to listen on.
            keys: keys of the run.
            on_malformed: called with the key of each message that does not parse, on the bus's
                thread.
        """
        self._on_malformed = on_malformed
        self._record = RunRecord()
        self._tokens: set[str] = set()
        self._processes: Counter[tuple[str, str]] = Counter()
        """The number of tokens of each process."""
        self._lock = threading.Lock()
        self._tokens_left_out = 0
        self._senders_without_token: Counter[tuple[str, str]] = Counter()
        bus.watch_alive(keys.all_alive(), self._note_life)
        bus.subscribe_raw(keys.all_stats, self._on_stats)

    def announce(self, received: Received) -> None:
        """Add a descriptor message, which announces the newest frame."""
        with self._lock:
            self._record.announce(received.header)

    def announce_sent(self, received: Received) -> None:
        """Add a frame message, which waits for the featurizer."""
        with self._lock:
            self._record.announce_sent(received.header)

    def status(self) -> RunStatus:
        """Return the status of the services."""
        with self._lock:
            return self._record.status(tuple(self._tokens), time.monotonic())

    @property
    def left_out(self) -> int:
        """How many tokens were over the limit, and how many senders have no token.

        A sender of one report is not counted: its token may still be on its way.
        """
        return self._tokens_left_out + sum(
            count > 1 for count in self._senders_without_token.copy().values()
        )

    def _on_stats(self, key: str, payload: bytes) -> None:
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
                self._record.update(*process, stats, time.monotonic())
            elif (
                process in self._senders_without_token
                or len(self._senders_without_token) < MOST_TOKENS
            ):
                self._senders_without_token[process] += 1

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
