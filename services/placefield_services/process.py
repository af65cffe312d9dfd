"""What every service process is: an inbox, a liveliness token, counts once a second, an end."""

import logging
import os
import signal
import sys
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import StatsMessage
from placefield.bus.session import Bus
from placefield.errors import MessageError

log = logging.getLogger(__name__)

_POLL_S = 0.1
_STATS_EVERY_S = 1.0

SUPERVISED = "PLACEFIELD_SUPERVISED"
"""Set in the environment of a service whose standard input ends when its host does."""


class ServiceProcess:
    """The life of one service on the bus."""

    def __init__(self, service: str, bus: Bus, keys: Keys) -> None:
        self.identity = uuid.uuid4().hex[:8]
        self.counts: Counter[str] = Counter()
        self._service = service
        self._bus = bus
        self._keys = keys
        self._stats_key = keys.stats(service, self.identity)
        self._stats_due = 0.0

    def sole(self) -> AbstractContextManager[None]:
        """Hold the token of a service of which a run has one; see ``Bus.sole``."""
        return self._bus.sole(self._keys, self._service, self.identity)

    def declare_ready(self, identity: str) -> None:
        """Declare the liveliness token; do so after subscribing, for it says that all is ready."""
        self._bus.declare_alive(self._keys.alive(self._service, identity))

    def serve(
        self,
        inbox: Inbox,
        handle: Callable[[Received], None],
        stop: threading.Event,
        *,
        idle: Callable[[], None] = lambda: None,
    ) -> None:
        """Handle what comes until ``stop`` is set; call ``idle`` after each message and each wait.

        A message that does not parse is counted as ``malformed`` and a call that fails as
        ``failed``: neither stops the service.
        """
        while not stop.is_set():
            received = inbox.take(_POLL_S)
            try:
                if received is not None:
                    self._handle(received, handle)
                idle()
            except Exception:
                self.counts["failed"] += 1
                log.exception("%s: a defect; going on with the next message", self._service)
            self._publish_stats()

    def _handle(self, received: Received, handle: Callable[[Received], None]) -> None:
        self.counts["received"] += 1
        try:
            handle(received)
        except MessageError as error:
            self.counts["malformed"] += 1
            self._bus.log_dropped(received.key, error)

    def _publish_stats(self) -> None:
        now = time.monotonic()
        if now >= self._stats_due:
            self._stats_due = now + _STATS_EVERY_S
            stats = StatsMessage(service=self._service, counts=dict(self.counts))
            self._bus.put(self._stats_key, stats)


def stop_event() -> threading.Event:
    """Return an event that SIGINT, SIGTERM and, under a host, the host's end set."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    if os.environ.get(SUPERVISED):
        threading.Thread(target=_wait_for_host, args=(stop,), daemon=True).start()
    return stop


def _wait_for_host(stop: threading.Event) -> None:
    while os.read(sys.stdin.fileno(), 1):
        pass
    stop.set()
