"""Runs services as child processes, signals them, and restarts those that died."""

import signal
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Self

from placefield_services.child_environment import supervised_environment
from placefield_tools.chaos.clock import Clock

_POLL_S = 0.05
_RESTART_AFTER_S = 0.5
_END_S = 3.0

Start = Callable[[Sequence[str]], "subprocess.Popen[bytes]"]


def start_process(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Start a service that ends when this process does."""
    return subprocess.Popen(
        command,
        stdin=subprocess.PIPE,  # it closes with this process, and the child notices
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,  # services log the faults of the others
        env=supervised_environment(),
        start_new_session=True,
    )


class Children:
    """Services by name. A ``with`` block keeps all of them running, and stops them at its end."""

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        clock: Clock,
        start: Start = start_process,
    ) -> None:
        """Keep the command lines, by name of the service."""
        self._commands = commands
        self._clock = clock
        self._start = start
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._died: dict[str, float] = {}
        self._lock = threading.Lock()
        self._enough = threading.Event()
        self._keeper = threading.Thread(target=self._keep, daemon=True)

    def __enter__(self) -> Self:
        self.start()
        self._keeper.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._enough.set()
        self._keeper.join()
        self.stop()

    def start(self) -> None:
        """Start all services."""
        for name, command in self._commands.items():
            self._running[name] = self._start(command)

    def stop(self) -> None:
        """Stop all services."""
        for process in self._running.values():
            process.send_signal(signal.SIGCONT)
            process.terminate()
        for process in self._running.values():
            _finish(process)

    def names(self, service: str) -> list[str]:
        """Return the names that begin with ``service``."""
        return [name for name in self._commands if name.startswith(service)]

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a service; a dead service gets none."""
        with self._lock, suppress(KeyError):
            self._running[name].send_signal(number)

    def _keep(self) -> None:
        while not self._enough.is_set():
            self.keep_running()
            self._clock.sleep(_POLL_S)

    def keep_running(self) -> None:
        """Restart services that died half a second ago or earlier."""
        now = self._clock.monotonic()
        with self._lock:
            for name, process in list(self._running.items()):
                if process.poll() is not None:
                    _finish(self._running.pop(name))
                    self._died[name] = now
            for name, since in list(self._died.items()):
                if now >= since + _RESTART_AFTER_S:
                    del self._died[name]
                    self._running[name] = self._start(self._commands[name])


def _finish(process: "subprocess.Popen[bytes]") -> None:
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdin is not None:
        process.stdin.close()
