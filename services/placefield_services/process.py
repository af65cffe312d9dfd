"""The frame of every service process: its loop, liveliness token, statistics and end."""

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
from multiprocessing import parent_process
from queue import SimpleQueue
from typing import NoReturn, TypeVar

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import StatsMessage
from placefield.bus.refusing import count_refused
from placefield.bus.replay_cache import ReplayCache
from placefield.bus.session import Bus
from placefield.errors import MapError, MessageError
from placefield_services.background_query import NotYet
from placefield_services.child_environment import SUPERVISED
from placefield_services.notifying import notify_alive, notify_ready
from placefield_services.prometheus import ReportedStats

log = logging.getLogger(__name__)

_POLL_S = 0.1
_STATS_EVERY_S = 1.0
_END_WITHIN_S = 1.0

AT_ONCE = 16
"""The most messages that a service handles in one batch. A batch shares work, but must not make the
next stage wait for long."""

Work = TypeVar("Work")


class ServiceProcess:
    """The life of one service on the bus, in one or more runs."""

    def __init__(self, service: str, bus: Bus, runs: Sequence[str]) -> None:
        self.identity = uuid.uuid4().hex[:8]
        self.keys = {run: Keys(run) for run in runs}
        self.counts: dict[str, Counter[str]] = {run: Counter() for run in runs}
        self.answers: dict[str, ReplayCache] = {}
        """By run, the cache whose newest answer is reported."""
        self.channels: int | None = None
        """How many channels the map has; reported by the service that needs them all."""
        self.maps: dict[str, str] = {}
        """By run, the digest of the map that the service answers by; reported if it has one."""
        self._service = service
        self._bus = bus
        self._stats_due = 0.0

    @contextmanager
    def sole(self) -> Iterator[None]:
        """Hold the tokens of a service of which each run has only one; see ``Bus.sole``."""
        with ExitStack() as tokens:
            for keys in self.keys.values():
                tokens.enter_context(self._bus.sole(keys, self._service, self.identity))
            yield

    def declare_ready(self, identity: str) -> None:
        """Declare the liveliness tokens, after subscribing: a token means that all is ready."""
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
        """Serve until ``stop`` is set: handle waiting messages in batches.

        A malformed message is counted as ``malformed``, a message of another map as ``other_map``,
        and a message that is lost to a defect as ``failed``, in its run. None of them stops the
        service.

        Args:
            inbox: of all runs.
            accept: called with each message; returns the work to do for it, or None. If it raises
                ``NotYet``, it is called with the same message again later.
            stop: ends the service.
            at_once: the most messages of a batch.
            work: called with the accepted work of a batch, in order.
            after_batch: called with each run after each batch and each wait.
        """
        gc.freeze()  # the objects of the libraries stay for ever
        gc.enable()
        notify_ready()
        while not stop.is_set():
            received = inbox.get_batch(_POLL_S, at_once)
            self._bus.outbox.begin()
            accepted = list(self._accept(inbox, received, accept))
            if accepted:
                with counting_failure(self.counts[run] for run, _ in accepted):
                    work([todo for _, todo in accepted])
            if after_batch is not None:
                self._finish_batch(after_batch)
            if not inbox.is_waiting or self._bus.outbox.is_due:
                with counting_failure(self.counts.values()):
                    self._bus.outbox.send_all()
            self._report_if_due()

    def _accept(
        self,
        inbox: Inbox,
        received: Sequence[Received],
        accept: Callable[[Received], Work | None],
    ) -> Iterator[tuple[str, Work]]:
        """Yield each run and its work; put back the messages that must wait."""
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
        """Publish the statistics, and notify the supervisor, once a second."""
        now = time.monotonic()
        if now >= self._stats_due:
            self._stats_due = now + _STATS_EVERY_S
            notify_alive()
            for run, keys in self.keys.items():
                self._bus.put(keys.stats(self._service, self.identity), self._stats(run))

    def report(self) -> Iterator[ReportedStats]:
        """Yield the statistics of each run."""
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
            map=self.maps.get(run),
        )


@contextmanager
def counting_failure(counts: Iterable[Counter[str]]) -> Iterator[None]:
    """Survive a defect: count it as ``failed`` in each of these runs, and log it.

    A changed map is not survived: nothing can be matched with it.
    """
    try:
        yield
    except MapError:
        raise
    except Exception:
        for of_run in counts:
            of_run["failed"] += 1
        log.exception("a defect; continuing with the next message")


def begin() -> None:
    """Begin a process that will serve: turn off garbage collection until it does.

    Collecting the objects of libraries while they load takes a tenth of the time of a start, and
    frees nothing.
    """
    gc.disable()


def leave() -> NoReturn:
    """End this process at once, without shutting the interpreter down.

    An orderly shutdown of the interpreter and the compiler would take longer than everything else
    at the end, and a host waits for many services.
    """
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def stop_event() -> threading.Event:
    """Return an event that is set by SIGINT, by SIGTERM and, under a host, by the host's end."""
    stop, received = threading.Event(), SimpleQueue[int]()
    for number in (signal.SIGINT, signal.SIGTERM):
        # A handler may interrupt the event's own methods, which hold its lock; the queue has none.
        signal.signal(number, lambda number, _: received.put(number))
    threading.Thread(target=_wait_for_signal, args=(received, stop), daemon=True).start()
    if parent_process() is not None or os.environ.get(SUPERVISED):
        threading.Thread(target=_wait_for_host, args=(stop,), daemon=True).start()
    return stop


def stop_of_service() -> threading.Event:
    """Return ``stop_event()`` for a service; the process ends soon after the event is set.

    A service that is still starting does not check the event, and has nothing to finish.
    """
    stop = stop_event()
    threading.Thread(target=_end_soon_after, args=(stop,), daemon=True).start()
    return stop


def _end_soon_after(stop: threading.Event) -> None:
    stop.wait()
    time.sleep(_END_WITHIN_S)
    leave()


def _wait_for_signal(received: SimpleQueue[int], stop: threading.Event) -> None:
    received.get()
    stop.set()


def _wait_for_host(stop: threading.Event) -> None:
    if (host := parent_process()) is not None:
        host.join()
    else:
        while os.read(sys.stdin.fileno(), 1):
            pass
    stop.set()
