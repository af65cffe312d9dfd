"""A slow or stopped viewer does not block the pipeline."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage
from placefield.bus.session import Bus
from placefield.bus.settings import VIEWERS
from placefield.config import BusConfig

KEYS = Keys("test")
PATIENCE_S = 30.0
VIEWER = """
import sys, time
from placefield.bus.keys import Keys
from placefield.bus.connecting import open_bus
from placefield.config import BusConfig
with open_bus(BusConfig(endpoint=sys.argv[1]), viewer=True) as bus:
    bus.subscribe_raw(Keys("test").frame, lambda key, payload: None)
    bus.declare_alive(Keys("test").alive("viewer", "1"))
    time.sleep(60)
"""


@pytest.fixture
def router(endpoint: str) -> Iterator[Bus]:
    with open_router(BusConfig(endpoint=endpoint)) as opened:
        yield opened


@pytest.mark.usefixtures("router")
def test_a_stopped_viewer_does_not_block_the_pipeline(endpoint: str) -> None:
    """If the router waited, it would send nothing more until it drops the viewer."""
    frame = FrameMessage(image=np.random.default_rng(0).bytes(900_000)).encode()
    command = [sys.executable, "-c", VIEWER, endpoint]
    with open_bus(BusConfig(endpoint=endpoint)) as bus, subprocess.Popen(command) as viewer:
        try:
            end = time.monotonic() + PATIENCE_S
            while not (tokens := bus.alive(KEYS.all_alive())):
                assert time.monotonic() < end, "the viewer did not come"
                time.sleep(0.05)
            publisher = bus.publisher(KEYS.frame)
            viewer.send_signal(signal.SIGSTOP)
            for number in range(60):
                publisher.send(Header(stream="a", sequence=number, stamp_ns=0), frame)
            assert bus.alive(KEYS.all_alive()) == tokens
        finally:
            viewer.kill()


def test_each_viewer_has_an_identity_of_its_own_as_long_as_one_is_free(
    router: Bus, endpoint: str
) -> None:
    config = BusConfig(endpoint=endpoint)
    with open_bus(config, viewer=True) as one, open_bus(config, viewer=True) as other:
        assert one.identity != other.identity
        assert {one.identity, other.identity} & set(VIEWERS)
