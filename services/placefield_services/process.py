"""What every service process is: an inbox, a liveliness token, counts once a second, an end."""

import gc
import logging
import os
import signal
import sys
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import NoReturn, TypeVar

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import StatsMessage
from placefield.bus.refusing import count_refused
from placefield.bus.replay_cache import ReplayCache
from placefield.bus.session import Bus
from placefield.errors import MapError, MessageError
from placefield_services.background_query import NotYet
from placefield_services.notifying import notify_alive, notify_ready
from placefield_services.prometheus import ReportedStats

log = logging.getLogger(__name__)

_POLL_S = 0.1
_STATS_EVERY_S = 1.0
_END_WITHIN_S = 1.0

AT_ONCE = 16
"""Messages that a service takes together: they share what can be shared, and the next stage does
not wait long for them."""

SUPERVISED = "PLACEFIELD_SUPERVISED"
"""Set in the environment of a service whose standard input ends when its host does."""

Work = TypeVar("Work")


class ServiceProcess:
    """The life of one service on the bus, in one or more runs."""

    def __init__(self, service: str, bus: Bus, runs: Sequence[str]) -> None:
        self.identity = uuid.uuid4().hex[:8]
        self.keys = {run: Keys(run) for run in runs}
        self.counts: dict[str, Counter[str]] = {run: Counter() for run in runs}
        self.answers: dict[str, ReplayCache] = {}
        """Of the runs in which the newest answer is to be told."""
        self.channels: int | None = None
        """Of the map, to be told where the service awaits them all."""
        self.map: str | None = None
        """Digest of the service's map, to be told where it has one."""
        self._service = service
        self._bus = bus
        self._stats_due = 0.0

    @contextmanager
    def sole(self) -> Iterator[None]:
        """Hold the tokens of a service of which a run has one; see ``Bus.sole``."""
        with ExitStack() as tokens:
            for keys in self.keys.values():
                tokens.enter_context(self._bus.sole(keys, self._service, self.identity))
            yield

    def declare_ready(self, identity: str) -> None:
        """Declare the liveliness tokens; do so after subscribing: they say that all is ready."""
        for keys in self.keys.values():
            self._bus.declare_alive(keys.alive(self._service, identity))

    def serve(
        self,
        inbox: Inbox,
        accept: Callable[[Received], Work | None],
        stop: threading.Event,
        *,
        at_once: int = AT_ONCE,
        work: Callable[[Sequence[Work]], None] = lambda accepted: None,
        after_batch: Callable[[str], None] | None = None,
    ) -> None:
        """Serve until ``stop`` is set: what waits is taken together.

        A message that does not parse is counted as ``malformed``, one of another map as
        ``other_map`` and one that is lost to a defect as ``failed``, in its run: none of them stops
        the service.

        Args:
            inbox: of all runs.
            accept: called with each message; returns what there is to do for it, if anything, or
                raises ``NotYet``, and is called with it again.
            stop: ends the service.
            at_once: how many messages are taken together at most.
            work: called with what was accepted, in order.
            after_batch: called with each run, after that and after each wait.
        """
        gc.freeze()  # what has come with the libraries stays
        gc.enable()
        notify_ready()
        while not stop.is_set():
            accepted = list(self._accept(inbox, inbox.get_batch(_POLL_S, at_once), accept))
            if accepted:
                with counting_failure(self.counts[run] for run, _ in accepted):
                    work([todo for _, todo in accepted])
            if after_batch is not None:
                self._finish_batch(after_batch)
            self._report_if_due()

    def _accept(
        self,
        inbox: Inbox,
        received: Sequence[Received],
        accept: Callable[[Received], Work | None],
    ) -> Iterator[tuple[str, Work]]:
        """Yield what there is to do, and in which run; put back what is to wait."""
        waiting: dict[str, tuple[list[Received], float]] = {}
        for message in received:
            run = message.run
            if run in waiting:
                waiting[run][0].append(message)
                continue
            self.counts[run]["received"] += 1
            with counting_failure([self.counts[run]]):
                try:
                    todo = accept(message)
                except NotYet as not_yet:
                    self.counts[run]["received"] -= 1
                    waiting[run] = [message], not_yet.wait_s
                    continue
                except MessageError as error:
                    count_refused(self.counts[run], error)
                    self._bus.log_dropped(message.key, error)
                    continue
                if todo is not None:
                    yield run, todo
        for messages, wait_s in waiting.values():
            inbox.put_back(messages, wait_s)

    def _finish_batch(self, after_batch: Callable[[str], None]) -> None:
        for run in self.counts:
            with counting_failure([self.counts[run]]):
                after_batch(run)

    def _report_if_due(self) -> None:
        """Publish the counts, and tell the supervisor, once in a while."""
        now = time.monotonic()
        if now >= self._stats_due:
            self._stats_due = now + _STATS_EVERY_S
            notify_alive()
            for run, keys in self.keys.items():
                self._bus.put(keys.stats(self._service, self.identity), self._stats(run))

    def report(self) -> Iterator[ReportedStats]:
        """Yield what it has counted, by run."""
        for run in self.keys:
            yield ReportedStats(run, self.identity, self._stats(run))

    def _stats(self, run: str) -> StatsMessage:
        newest = self.answers[run].newest if run in self.answers else None
        return StatsMessage(
            service=self._service,
            counts=dict(self.counts[run]),
            stream=newest.stream if newest else None,
            sequence=newest.sequence if newest else None,
            channels=self.channels,
            map=self.map,
        )


@contextmanager
def counting_failure(counts: Iterable[Counter[str]]) -> Iterator[None]:
    """Outlive a defect that costs each of these runs a message: count it as ``failed``.

    A map that was written to is no such defect: nothing can be matched with it.
    """
    try:
        yield
    except MapError:
        raise
    except Exception:
        for of_run in counts:
            of_run["failed"] += 1
        log.exception("a defect; going on with the next message")


def begin() -> None:
    """Begin this process, which is to serve.

    No garbage is looked for until it does: to go through all that libraries make while they load,
    again and again, is a tenth of the work of a start, and finds nothing.
    """
    gc.disable()


def leave() -> NoReturn:
    """End this process, which has nothing left to do.

    To take the interpreter and its compiler down piece by piece takes longer than all else at the
    end, and a host has many services to wait for.
    """
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def stop_event() -> threading.Event:
    """Return an event that SIGINT, SIGTERM and, under a host, the host's end set."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    if os.environ.get(SUPERVISED):
        threading.Thread(target=_wait_for_host, args=(stop,), daemon=True).start()
    return stop


def stop_of_service() -> threading.Event:
    """Return ``stop_event()`` for a service, which ends soon after it is set, whatever it does.

    One that is still starting does not look whether it is to stop, and has nothing to finish.
    """
    stop = stop_event()
    threading.Thread(target=_end_soon_after, args=(stop,), daemon=True).start()
    return stop


def _end_soon_after(stop: threading.Event) -> None:
    stop.wait()
    time.sleep(_END_WITHIN_S)
    leave()


def _wait_for_host(stop: threading.Event) -> None:
    while os.read(sys.stdin.fileno(), 1):
        pass
    stop.set()
