"""Routers and their clients in one process, also routers of several hosts."""

import queue
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack

import pytest

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys
from placefield.bus.messages import StatsMessage
from placefield.config import BusConfig
from placefield.errors import BusError
from placefield_tools.common.host_process import free_endpoint

KEYS = Keys("test")
ALIVE = KEYS.alive("fuser", "here")


@pytest.fixture
def config(endpoint: str) -> BusConfig:
    return BusConfig(endpoint=endpoint, connect_timeout_s=60)


def wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "in vain"
        time.sleep(0.01)


def test_without_a_router_a_client_gives_up_in_time_and_says_where_it_looked(
    config: BusConfig,
) -> None:
    hurried = config.model_copy(update={"connect_timeout_s": 0.3})
    with pytest.raises(BusError, match=f"no router at {config.endpoint}.*placefield up"):
        open_bus(hurried).__enter__()


def test_a_client_that_is_stopped_no_longer_waits(config: BusConfig) -> None:
    patient = config.model_copy(update={"connect_timeout_s": 3600})
    stop = threading.Event()
    stop.set()
    with pytest.raises(BusError, match="no router"):
        open_bus(patient, stop).__enter__()


def test_a_client_finds_a_router_that_was_started_again(config: BusConfig) -> None:
    received: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with ExitStack() as stack:
        with open_router(config):
            client = stack.enter_context(open_bus(config))
            client.subscribe_raw(KEYS.all_stats, lambda _, payload: received.put(payload))
        restarted = stack.enter_context(open_router(config))
        stats = StatsMessage(service="fuser", counts={})

        def is_received() -> bool:
            restarted.put(KEYS.stats("fuser", "ab12"), stats)
            return not received.empty()

        wait_until(is_received)


def test_a_client_waits_for_a_router_that_starts_later(config: BusConfig) -> None:
    connected = threading.Event()

    def connect() -> None:
        with open_bus(config):
            connected.set()

    client = threading.Thread(target=connect)
    client.start()
    time.sleep(0.3)
    assert not connected.is_set()
    with open_router(config):
        client.join(60)
    assert connected.is_set()


def test_a_port_in_use_is_refused_by_name(config: BusConfig) -> None:
    refused = pytest.raises(BusError, match=f"cannot listen at {config.endpoint}.*--endpoint")
    with open_router(config), refused:
        open_router(config).__enter__()


@pytest.mark.parametrize("endpoint", ["", "nonsense", "tcp", "127.0.0.1:7557", "tcp/127.0.0.1"])
def test_a_malformed_endpoint_is_refused_by_name(endpoint: str) -> None:
    config = BusConfig(endpoint=endpoint, connect_timeout_s=0.3)
    for opener in (open_router, open_bus):
        with pytest.raises(BusError, match=f"'{endpoint}' is malformed.*tcp/HOST:PORT"):
            opener(config).__enter__()


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
