"""Real processes notify a supervisor until they hang."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from hosting import PATIENCE_S, Process, free_endpoint, wait_until

from placefield_services.notifying import NOTIFY_SOCKET


@contextmanager
def watched(
    monkeypatch: pytest.MonkeyPatch, folder: Path, *command: str | Path
) -> Iterator[tuple[Process, socket.socket]]:
    """Run a command whose supervisor is this process."""
    name = f"placefield-{time.monotonic_ns()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.bind(f"\0{name}")
        supervisor.settimeout(PATIENCE_S)
        with monkeypatch.context() as patch:
            patch.setenv(NOTIFY_SOCKET, f"@{name}")
            process = Process(folder, *command)
            process.__enter__()
        try:
            yield process, supervisor
        finally:
            process.__exit__(None, None, None)


def notifications(supervisor: socket.socket) -> list[bytes]:
    """Take what has been said so far."""
    supervisor.settimeout(0)
    said = []
    with suppress(BlockingIOError):
        while True:
            said.append(supervisor.recv(100))
    return said


def assert_silent_while_stopped(process: Process, supervisor: socket.socket) -> None:
    """Check that no notification comes while the process hangs, and that one comes after."""
    for _ in range(2):
        assert supervisor.recv(100) == b"WATCHDOG=1"
    stopped = psutil.Process(process.pid)
    stopped.suspend()
    wait_until(lambda: stopped.status() == psutil.STATUS_STOPPED, "it has stopped")
    notifications(supervisor)
    supervisor.settimeout(2)
    with pytest.raises(TimeoutError):
        supervisor.recv(100)
    stopped.resume()
    supervisor.settimeout(PATIENCE_S)
    assert supervisor.recv(100) == b"WATCHDOG=1"


def test_a_supervisor_is_notified_by_a_router_and_a_service_until_they_hang(
    monkeypatch: pytest.MonkeyPatch, logs: Path, map_path: Path
) -> None:
    at = ("--endpoint", free_endpoint())
    with (
        watched(monkeypatch, logs, "router", *at) as (router, of_router),
        watched(monkeypatch, logs, "featurizer", map_path, *at) as (featurizer, of_featurizer),
    ):
        assert of_router.recv(100) == b"READY=1"
        assert router.out == f"ready: router at {at[1]}\n"
        assert of_featurizer.recv(100) == b"READY=1"
        assert_silent_while_stopped(featurizer, of_featurizer)
        assert_silent_while_stopped(router, of_router)
        assert router.stop() == 0
        assert not router.err


def test_a_supervisor_of_a_host_is_notified_only_by_the_host_once_all_is_ready(
    monkeypatch: pytest.MonkeyPatch, logs: Path, map_path: Path
) -> None:
    with watched(monkeypatch, logs, "up", map_path, "--endpoint", free_endpoint()) as (
        host,
        supervisor,
    ):
        while (said := supervisor.recv(100)) != b"READY=1":  # which services would say before
            assert said == b"WATCHDOG=1"
        wait_until(lambda: host.out.startswith("ready: "), "the host is ready")
        assert supervisor.recv(100) == b"WATCHDOG=1"
        assert set(notifications(supervisor)) <= {b"WATCHDOG=1"}
