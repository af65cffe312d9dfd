"""Routers of several hosts, in one process."""

import time
from collections.abc import Callable

import pytest

from placefield.bus.keys import Keys
from placefield.bus.session import open_bus, open_router
from placefield.config import BusConfig
from placefield.errors import BusError
from placefield_tools.common.host_process import free_endpoint

KEYS = Keys("test")
ALIVE = KEYS.alive("fuser", "here")


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "in vain"
        time.sleep(0.01)


def test_clients_of_connected_routers_meet_whichever_router_comes_first(endpoint: str) -> None:
    one = BusConfig(endpoint=endpoint)
    other = BusConfig(endpoint=free_endpoint(), connect=(endpoint,))
    with open_router(other), open_bus(other) as waiting:
        waiting.declare_alive(ALIVE)
        with open_router(one), open_bus(one) as come:
            wait_until(lambda: come.alive(KEYS.all_alive()) == {ALIVE})


def test_a_router_to_connect_to_that_is_malformed_is_refused_by_name(endpoint: str) -> None:
    config = BusConfig(endpoint=endpoint, connect=("other",))
    with (
        pytest.raises(BusError, match=r"bus\.connect 'other' is malformed"),
        open_router(config),
    ):
        pass
