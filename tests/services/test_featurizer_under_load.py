"""A featurizer on a real bus, whose answers come before it has gone on."""

import itertools
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from bus_doubles import header

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage
from placefield.bus.publishing import GatheringPublisher
from placefield.bus.session import Bus
from placefield.config import Config
from placefield.maps.map import Map
from placefield_services.featurizer import run_featurizer

RUNS = tuple(f"camera{number}" for number in range(8))  # so many may have one frame under way each
KEYS = Keys(RUNS[3])
PATIENCE_S = 60.0


@pytest.fixture
def bus(endpoint: str, route_map: Map, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bus]:
    """A client of a featurizer that is slow to go on once it has published a descriptor."""
    send = GatheringPublisher.send

    def send_and_wait(self: GatheringPublisher, about: Header, payload: bytes) -> None:
        send(self, about, payload)
        time.sleep(0.05)

    monkeypatch.setattr(GatheringPublisher, "send", send_and_wait)
    config = Config.model_validate(
        {"runs": RUNS, "bus": {"endpoint": endpoint}, "fusion": {"deadline_s": PATIENCE_S}}
    )
    stop = threading.Event()
    service = threading.Thread(target=run_featurizer, args=(route_map, config, stop))
    with open_router(config.bus), open_bus(config.bus) as client:
        service.start()
        try:
            yield client
        finally:
            stop.set()
            service.join()


@pytest.fixture
def described(bus: Bus) -> threading.Semaphore:
    """Count the frames that were described; each is answered at once."""
    described, acks = threading.Semaphore(0), bus.publisher(KEYS.ack)

    def answer(received: Received) -> None:
        acks.put(received.header)
        described.release()

    bus.subscribe(KEYS.feature, answer, Counter())
    while not bus.alive(KEYS.all_alive("featurizer")):
        time.sleep(0.01)
    return described


def test_a_live_frame_waits_for_none_that_is_answered_or_refused_or_came_twice(
    bus: Bus, described: threading.Semaphore, query_dir: Path
) -> None:
    frames = bus.publisher(KEYS.frame)
    image = min(query_dir.iterdir()).read_bytes()
    for number in range(0, 8, 2):
        frames.put(header(number, live=True), FrameMessage(image=image))
        assert described.acquire(timeout=PATIENCE_S / 2), f"frame {number} waits"
        frames.put(header(number, live=True), FrameMessage(image=image))
        frames.send(header(number + 1, live=True), b"no frame")


def test_a_stream_that_is_on_is_described_though_newer_frames_displace_those_that_wait(
    bus: Bus, described: threading.Semaphore, query_dir: Path
) -> None:
    frames = bus.publisher(KEYS.frame)
    image = min(query_dir.iterdir()).read_bytes()
    end = time.monotonic() + PATIENCE_S / 2
    for number in itertools.count(5):  # each asks other services for the earlier frames
        frames.put(header(number, live=True), FrameMessage(image=image))
        if described.acquire(timeout=0.01):
            break
        assert time.monotonic() < end, "no frame is described"
