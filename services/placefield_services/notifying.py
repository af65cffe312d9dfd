"""Word to the supervisor that started this process, as systemd's sd_notify(3) has it.

Nothing is said where there is none. What says ``alive`` is to be the loop that does the work, never
a thread beside it: a supervisor that hears nothing takes the process for hung.
"""

import os
import socket
from contextlib import suppress

NOTIFY_SOCKET = "NOTIFY_SOCKET"
"""The supervisor's socket, in the environment."""


def notify_ready() -> None:
    """Say that this process serves from now on."""
    _notify(b"READY=1")


def notify_alive() -> None:
    """Say that this process does not hang."""
    _notify(b"WATCHDOG=1")


def _notify(state: bytes) -> None:
    address = os.environ.get(NOTIFY_SOCKET)
    if not address:
        return
    if address.startswith("@"):  # in no file system
        address = "\0" + address[1:]
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.setblocking(False)  # a supervisor that does not listen holds nobody up
        supervisor.sendto(state, address)
