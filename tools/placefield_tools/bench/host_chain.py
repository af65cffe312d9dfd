"""Chains of services to measure: whole hosts, each on a port of its own."""

import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import psutil  # type: ignore[import-untyped]

from placefield.loading import ENV_PREFIX
from placefield_tools.common.host_process import await_ready, free_endpoint

_START_S = 180.0  # that many processes at once take their time on few cores
_END_S = 30.0


@dataclass(frozen=True)
class Chain:
    """A host that is ready.

    Attributes:
        endpoint: of its router.
        pid: of the process that started all others.
    """

    endpoint: str
    pid: int

    def cpu_seconds(self) -> float:
        """Return how long all its processes have computed since they started."""
        times = [process.cpu_times() for process in self._processes()]
        return float(sum(time.user + time.system for time in times))

    def resident_bytes(self) -> int:
        """Return how much memory all its processes take; what they share counts once."""
        return sum(process.memory_full_info().pss for process in self._processes())

    def resident_by_process(self) -> dict[int, int]:
        """Return how much memory each of its processes takes by itself, bytes, by its pid."""
        return {process.pid: process.memory_info().rss for process in self._processes()}

    def _processes(self) -> list[psutil.Process]:
        host = psutil.Process(self.pid)
        return [host, *host.children(recursive=True)]


@contextmanager
def started(commands: Sequence[Sequence[str]]) -> Iterator[list[Chain]]:
    """Start hosts together; they are ready inside the block and gone after it.

    Args:
        commands: that take ``--endpoint`` and print a line when they are ready.

    Raises:
        BusError: one does not get ready.
    """
    hosts = []
    try:
        for command in commands:
            endpoint = free_endpoint()
            hosts.append((endpoint, _start([*command, "--endpoint", endpoint])))
        for _, process in hosts:
            await_ready(process, _START_S)
        yield [Chain(endpoint, process.pid) for endpoint, process in hosts]
    finally:
        for _, process in hosts:
            process.terminate()  # all at once: each takes a while to end
        for _, process in hosts:
            _await_end(process)


def _start(command: Sequence[str]) -> subprocess.Popen[str]:
    """Start a command with default settings."""
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=default_environment())


def default_environment() -> dict[str, str]:
    """Return this process's environment without settings."""
    return {name: value for name, value in os.environ.items() if not name.startswith(ENV_PREFIX)}


def _await_end(process: subprocess.Popen[str]) -> None:
    with process:
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()  # its services notice
