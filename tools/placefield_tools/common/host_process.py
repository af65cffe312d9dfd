"""Hosts as child processes: a free endpoint, and waiting until they are ready."""

import socket
import subprocess
import threading

from placefield.errors import BusError


def free_endpoint() -> str:
    """Return a free endpoint on loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def await_ready(process: subprocess.Popen[str], patience_s: float) -> None:
    """Wait for the line on its standard output in which a host says that it is ready.

    Raises:
        BusError: the process ended, or was killed because it was not ready in time.
    """
    timer = threading.Timer(patience_s, process.kill)
    timer.start()
    try:
        assert process.stdout is not None
        if not process.stdout.readline().startswith("ready"):
            raise BusError(f"the services did not start within {patience_s:g} s; see above")
    finally:
        timer.cancel()
