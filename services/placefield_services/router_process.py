"""A router process: it connects the processes of a host, and hosts with each other."""

import threading
from collections.abc import Callable

from placefield.bus.connecting import open_router
from placefield.config import BusConfig
from placefield_services.notifying import notify_alive, notify_ready

_ALIVE_EVERY_S = 1.0


def run_router(config: BusConfig, stop: threading.Event, on_ready: Callable[[], None]) -> None:
    """Route until ``stop`` is set; ``on_ready`` is called once, when clients can connect.

    Raises:
        BusError: an endpoint is malformed or in use.
    """
    with open_router(config):
        on_ready()
        notify_ready()
        while not stop.wait(_ALIVE_EVERY_S):
            notify_alive()
