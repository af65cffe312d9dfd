"""Notifies the supervisor that started this process, by the protocol of systemd's sd_notify(3).

Without a supervisor this does nothing. Only the loop that does the work may call ``notify_alive``,
never another thread: if the notifications stop, the supervisor knows that the process hangs.
"""

import os
import socket
from contextlib import suppress

NOTIFY_SOCKET = "NOTIFY_SOCKET"
"""The environment variable with the supervisor's socket."""


def notify_ready() -> None:
    """Notify the supervisor that this process is ready."""
    _notify(b"READY=1")


def notify_alive() -> None:
    """Notify the supervisor that this process does not hang."""
    _notify(b"WATCHDOG=1")


def _notify(state: bytes) -> None:
    address = os.environ.get(NOTIFY_SOCKET)
    if not address:
        return
    if address.startswith("@"):  # a socket in the abstract namespace
        address = "\0" + address[1:]
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.setblocking(False)  # do not wait for a supervisor that does not read
        supervisor.sendto(state, address)
