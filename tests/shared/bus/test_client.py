"""The client for other programs, tested with simple services."""

import itertools
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import placefield
from placefield import BusError, Client, ConfigError, Frame, FrameError, Match, SourceError
from placefield.bus import sending
from placefield.bus.connecting import open_bus, open_router
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import FrameMessage, MatchMessage
from placefield.bus.replay_cache import ReplayCache, serve_cache
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.maps.digest import NO_DIGEST

KEYS = Keys("test")


class StandIn:
    """Answers each frame, once or repeatedly, with the place that its image names."""

    def __init__(self, bus: Bus, *, deaf_to: frozenset[int] = frozenset()) -> None:
        self.ended: list[str] = []
        self.stamps: list[int] = []
        self._deaf_to = deaf_to
        self._matches, self._acks = bus.publisher(KEYS.match), bus.publisher(KEYS.ack)
        self._cache = ReplayCache()
        serve_cache(bus, KEYS.cache(KEYS.match), self._cache)
        self._next: Counter[str] = Counter()
        bus.subscribe(KEYS.frame, self._receive, Counter())
        for service in ("featurizer", "fuser"):
            bus.declare_alive(KEYS.alive(service, "stand-in"))

    def _receive(self, received: Received) -> None:
        header = received.header
        if header.sequence in self._deaf_to and header.live and not header.end:
            return
        if header.sequence > self._next[header.stream] and not header.live:
            return  # one before it was lost
        self._next[header.stream] = max(self._next[header.stream], header.sequence + 1)
        payload = b""
        if header.end:
            self.ended.append(header.stream)
        else:
            image = FrameMessage.decode(received.payload).image
            place = image[0] if isinstance(image, bytes) else int(image[0, 0])
            self.stamps.append(header.stamp_ns)
            sent = Match(place, 1.5, pose=placefield.Pose(place, 0.0, 1.0))
            payload = MatchMessage.of(sent, map=NO_DIGEST).encode()
        self._cache.store(header, payload)
        self._matches.send(header, payload)
        self._acks.put(header)


@pytest.fixture
def services(endpoint: str) -> Iterator[StandIn]:
    config = BusConfig(endpoint=endpoint)
    with open_router(config), open_bus(config) as bus:
        yield StandIn(bus)


@pytest.fixture
def client(services: StandIn, endpoint: str) -> Iterator[Client]:
    with placefield.connect(endpoint, run="test") as connected:
        yield connected


def encoded(count: int) -> list[bytes]:
    return [bytes([number]) for number in range(count)]


def places(matches: Iterator[Match]) -> list[int]:
    return [match.place for match in matches]


def test_there_is_a_match_for_each_frame_in_order_and_with_its_pose(client: Client) -> None:
    matches = list(client.stream(encoded(100)))
    assert [match.place for match in matches] == list(range(100))
    assert matches[7] == Match(7, 1.5, pose=placefield.Pose(7, 0, 1))


def test_images_are_bytes_pixels_files_or_frames(
    client: Client, services: StandIn, tmp_path: Path
) -> None:
    file = tmp_path / "third.jpg"
    file.write_bytes(b"\2")
    pixels = np.full((8, 8), 1, np.uint8)
    images = [b"\0", pixels, file, Frame(9, 77, "", b"\3", odometry_m=4.0)]
    assert places(client.stream(images)) == [0, 1, 2, 3]
    assert services.stamps[3] == 77
    assert abs(services.stamps[0] - time.time_ns()) < 60 * 10**9


def test_one_stream_follows_another(client: Client, services: StandIn) -> None:
    assert [places(client.stream(encoded(3))) for _ in range(3)] == [[0, 1, 2]] * 3
    assert len(set(services.ended)) == 3


def test_a_match_comes_before_the_next_image_is_there(client: Client) -> None:
    has_matched = threading.Event()

    def slow() -> Iterator[bytes]:
        for image in encoded(3):
            yield image
            assert has_matched.wait(60)
            has_matched.clear()

    for number, match in enumerate(client.stream(slow())):
        assert match.place == number
        has_matched.set()


def test_a_stream_that_is_left_ends(client: Client, services: StandIn) -> None:
    for match in client.stream(itertools.repeat(b"\5")):
        assert match.place == 5
        break
    assert places(client.stream(encoded(2))) == [0, 1]
    assert len(set(services.ended)) == 2


def test_an_open_stream_ends_when_the_program_leaves(services: StandIn, endpoint: str) -> None:
    with placefield.connect(endpoint, run="test") as client:
        matches = client.stream(itertools.repeat(b"\5"))
        assert next(matches).place == 5
    assert list(matches) == []
    end = time.monotonic() + 60
    while not services.ended:
        assert time.monotonic() < end, "in vain"
        time.sleep(0.01)


def test_a_run_has_one_stream_at_a_time(client: Client) -> None:
    first = client.stream(itertools.repeat(b"\5"))
    assert next(first).place == 5
    with pytest.raises(BusError, match="has a replay already"):
        next(client.stream([b"\0"]))
    assert [next(first).place for _ in range(50)] == [5] * 50


def test_frames_that_a_live_stream_drops_are_unanswered(endpoint: str) -> None:
    config = BusConfig(endpoint=endpoint)
    with open_router(config), open_bus(config) as bus:
        StandIn(bus, deaf_to=frozenset({1, 2, 5}))
        with placefield.connect(endpoint, run="test") as client:
            assert places(client.stream(encoded(6), live=True)) == [0, -1, -1, 3, 4, -1]


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ("a name", SourceError),
        (Path("nothing.jpg"), SourceError),
        (np.zeros((8, 8)), FrameError),
    ],
)
def test_an_error_of_an_image_is_raised_after_the_earlier_matches(
    client: Client, services: StandIn, wrong: object, error: type[Exception]
) -> None:
    matches = client.stream([b"\0", b"\1", wrong])  # type: ignore[list-item]
    assert [next(matches).place for _ in range(2)] == [0, 1]
    with pytest.raises(error):
        next(matches)
    assert services.ended


def test_an_exception_of_the_images_is_raised(client: Client) -> None:
    def failing() -> Iterator[bytes]:
        yield b"\0"
        raise RuntimeError("the camera is gone")

    matches = client.stream(failing())
    assert next(matches).place == 0
    with pytest.raises(RuntimeError, match="the camera is gone"):
        next(matches)


def test_frames_under_way_when_the_router_restarts_are_matched(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sending, "_SEND_AGAIN_S", 0.2)
    config = BusConfig(endpoint=endpoint)
    is_away, is_back = threading.Event(), threading.Event()

    def images() -> Iterator[bytes]:
        for number, image in enumerate(encoded(60)):
            if number == 30:
                is_away.set()
                assert is_back.wait(60)
            yield image

    def restart() -> None:
        with open_router(config):
            is_away.wait(60)
        is_back.set()  # frames are sent to nobody now
        time.sleep(0.5)
        with open_router(config):
            is_over.wait(60)

    is_over = threading.Event()
    router = threading.Thread(target=restart)
    router.start()
    try:
        with open_bus(config) as bus:
            StandIn(bus)
            with placefield.connect(endpoint, run="test") as client:
                assert places(client.stream(images())) == list(range(60))
    finally:
        is_away.set()
        is_over.set()
        router.join()


def test_a_missing_service_is_reported_in_one_line(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, services: StandIn
) -> None:
    with pytest.raises(ConfigError, match="runs"), placefield.connect(endpoint, run="two words"):
        pass
    monkeypatch.setenv("PLACEFIELD_BUS__CONNECT_TIMEOUT_S", "0.3")
    nobody = endpoint.rpartition(":")[0] + ":1"
    with pytest.raises(BusError, match="no router at"), placefield.connect(nobody):
        pass
    with placefield.connect(endpoint, run="other") as client:
        assert repr(client) == f"Client({endpoint!r}, run='other')"
        with pytest.raises(BusError, match="run 'other' has no featurizer and no fuser"):
            next(client.stream([b"\0"]))


def test_the_client_gives_up_when_the_services_stop_answering(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sending, "_STALLED_S", 0.5)
    config = BusConfig(endpoint=endpoint)
    with open_router(config), open_bus(config) as bus:
        for service in ("featurizer", "fuser"):
            bus.declare_alive(KEYS.alive(service, "mute"))
        with (
            placefield.connect(endpoint, run="test") as client,
            pytest.raises(BusError, match="1 frames sent, 0 answered"),
        ):
            next(client.stream([b"\0"]))
