"""One host: an embedded router, and the services as child processes.

A service that dies is started again. At the end all services are stopped, and killed after
``_PATIENCE_S``. A service that gives up before all services were ready ends the host: it has logged
the reason, and would fail again. A service that dies too often ends the host, too, and so do
several services that die too often together.
"""

import itertools
import logging
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from multiprocessing.process import BaseProcess

from placefield.bus.connecting import open_router
from placefield.bus.keys import Keys, part_of, run_of, service_and_identity
from placefield.bus.session import MOST_TOKENS, Bus
from placefield.config import Config
from placefield.errors import BusError
from placefield_services.forkserver import LOST, Program, end_if_lost, fork
from placefield_services.notifying import notify_alive, notify_ready
from placefield_services.prometheus import ReceivedStats, serve_metrics

log = logging.getLogger(__name__)

_POLL_S = 0.05
_PATIENCE_S = 5.0  # services end sooner by themselves, unless the machine is overloaded
_RESTART_AFTER_S = 0.5
_MOST_DEATHS = 5  # of one service; plus the number of services for all together
_WITHIN_S = 600.0

_Role = tuple[str, int | None]  # a service, and which channel if it is one


def run_host(
    program: Program,
    commands: Mapping[str, Sequence[str]],
    channels: int,
    config: Config,
    stop: threading.Event,
    on_ready: Callable[[], None],
    *,
    others: Collection[str] = (),
    is_over: Callable[[Bus], bool] = lambda bus: False,
) -> None:
    """Run the named commands against an embedded router until ``stop`` is set, or ``is_over``.

    Args:
        program: runs the command lines.
        commands: command lines of the services, by a name for the log.
        channels: how many channels they serve together.
        config: its bus and runs.
        stop: ends the host.
        on_ready: called once, when featurizer, fuser and all channels of all runs are ready.
        others: services of each run that must be ready, too, for example ``replay``.
        is_over: called again and again with a session on the bus.

    Raises:
        BusError: the endpoint is in use, or services die too often.
        SystemExit: a service gave up at the start; the reason is on stderr.
    """
    with open_router(config.bus) as bus:
        if config.monitoring.port is not None:
            serve_metrics(config.monitoring, ReceivedStats(bus, config.runs).report)
        readiness = _Readiness(bus, config.runs, channels, others)
        deaths = _Deaths(len(commands))
        children = [_Child(name, program, command, deaths) for name, command in commands.items()]
        try:
            while not (stop.is_set() or is_over(bus)):
                for child in children:
                    if child.has_given_up() and not readiness.was_reported:
                        raise SystemExit(1)
                    child.keep_running()
                if readiness.is_reached():
                    on_ready()
                    notify_ready()
                notify_alive()
                stop.wait(_POLL_S)
        finally:
            _stop_all(children)


class _Readiness:
    """Reports once that all services are alive at the same time."""

    def __init__(
        self, bus: Bus, runs: Sequence[str], channels: int, others: Collection[str]
    ) -> None:
        roles: list[_Role] = [("featurizer", None), ("fuser", None)]
        roles += [("channel", channel) for channel in range(channels)]
        roles += [(service, None) for service in others]
        self._needed = set(itertools.product(runs, roles))
        self._alive: set[str] = set()
        self.was_reported = False
        for run in runs:
            bus.watch_alive(Keys(run).all_alive(), self._change)

    def _change(self, key: str, is_alive: bool) -> None:
        if not is_alive:
            self._alive.discard(key)
        elif (run_of(key), _role(key)) in self._needed and len(self._alive) < MOST_TOKENS:
            self._alive.add(key)

    def is_reached(self) -> bool:
        if self.was_reported:
            return False
        if not self._needed <= {(run_of(key), _role(key)) for key in tuple(self._alive)}:
            return False
        self.was_reported = True
        return True


def _role(key: str) -> _Role:
    service, identity = service_and_identity(key)
    return service, _channel_of(identity) if service == "channel" else None


def _channel_of(identity: str) -> int | None:
    part = part_of(identity)
    return part.channel if part else None


class _Deaths:
    """The recent deaths of services, so that none is restarted for ever."""

    def __init__(self, services: int) -> None:
        self._most = _MOST_DEATHS + services
        self._lately: deque[tuple[float, str, int]] = deque()

    def note(self, name: str, code: int, now: float) -> None:
        """Note a death at ``now`` (monotonic seconds).

        Services that are lost with the forkserver count one by one, but not all together.

        Raises:
            BusError: there have been too many deaths.
        """
        self._lately.append((now, name, code))
        while self._lately[0][0] < now - _WITHIN_S:
            self._lately.popleft()
        within = f"within {_WITHIN_S / 60:g} minutes"
        own = sum(other == name for _, other, _ in self._lately)
        if own >= _MOST_DEATHS:
            raise BusError(
                f"{name} {_how_ended(code)} {own} times in a row {within}; see its message above"
            )
        if sum(code != LOST for _, _, code in self._lately) >= self._most:
            raise BusError(
                f"services died {self._most} times {within}, {name} last; see their messages above"
            )


class _Child:
    """One service process and its restarts."""

    def __init__(
        self, name: str, program: Program, command: Sequence[str], deaths: _Deaths
    ) -> None:
        self._name = name
        self._program = program
        self._command = command
        self._deaths = deaths
        self._start_at = 0.0
        self._process: BaseProcess | None = None

    def has_given_up(self) -> bool:
        """Return whether the process has ended by itself with an error."""
        return self._process is not None and (self._process.exitcode or 0) in range(1, LOST)

    def keep_running(self) -> None:
        """Start the process, or restart it shortly after it died."""
        now = time.monotonic()
        if self._process is not None and (code := self._process.exitcode) is not None:
            self._release(self._process)
            self._note_death(code, now)
        if self._process is None and now >= self._start_at:
            try:
                self._process = fork(self._program, self._command)
            except (EOFError, ConnectionError):
                self._note_death(LOST, now)

    def _note_death(self, code: int, now: float) -> None:
        self._start_at = now + _RESTART_AFTER_S
        self._deaths.note(self._name, code, now)
        log.warning("%s %s; starting it again", self._name, _how_ended(code))

    def terminate(self) -> None:
        """Ask the process to end."""
        if self._process is not None:
            self._process.terminate()

    def finish(self, deadline: float) -> None:
        """Wait for the process to end; kill it at the deadline (monotonic seconds)."""
        if self._process is None:
            return
        self._process.join(max(0.0, deadline - time.monotonic()))
        if self._process.exitcode is None:
            log.warning("%s did not end; killing it", self._name)
            self._process.kill()
            self._process.join()
        self._release(self._process)

    def _release(self, process: BaseProcess) -> None:
        end_if_lost(process)
        process.close()
        self._process = None


def _how_ended(code: int) -> str:
    if code == LOST:
        return "was lost, as the forkserver was killed"
    if code >= 0:
        return f"ended with code {code}"
    with suppress(ValueError):  # real-time signals have no names
        return f"was ended by {signal.Signals(-code).name}"
    return f"was ended by signal {-code}"


def _stop_all(children: Sequence[_Child]) -> None:
    deadline = time.monotonic() + _PATIENCE_S
    for child in children:
        child.terminate()
    for child in children:
        child.finish(deadline)
