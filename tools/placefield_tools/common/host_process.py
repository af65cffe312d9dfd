"""Hosts as child processes: a free endpoint, and waiting until they are ready."""

import secrets
import socket
import subprocess
import threading
from contextlib import suppress

from placefield.errors import BusError

_PORTS = range(20_000, 32_768)
"""Below the ports that Linux and macOS give to connections, so that none takes a free one."""


def free_endpoint() -> str:
    """Return a free endpoint on loopback."""
    while True:
        port = secrets.choice(_PORTS)
        with socket.socket() as probe, suppress(OSError):  # the port is in use
            probe.bind(("127.0.0.1", port))
            return f"tcp/127.0.0.1:{port}"


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
