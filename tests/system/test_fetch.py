"""A map from host to host, with real processes that are killed on the way."""

import os
import resource
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hosting import Host, Listener, Process, placefield, refusal, wait_until

from placefield.bus.connecting import open_bus, open_router
from placefield.config import BusConfig
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield.maps.transfer import CHUNK, OwnMap

LONG = 160  # chunks of the largest file of a large map: so many that there is time to kill somebody


@pytest.fixture(scope="module")
def large_path(tmp_path_factory: pytest.TempPathFactory, route_map: Map) -> Path:
    """The route's map with thumbnails that are slow to send; do not change it."""
    ends = route_map.places.thumbnail_ends.copy()
    ends[-1] = LONG * CHUNK - CHUNK // 2
    pixels = np.random.default_rng(4).integers(0, 256, ends[-1], np.uint8)
    path = tmp_path_factory.mktemp("large") / "large.pfmap"
    places = replace(route_map.places, thumbnails=pixels, thumbnail_ends=ends)
    save_map(replace(route_map, places=places), path)
    return path


class Server:
    """``placefield serve`` at a router of its own."""

    def __init__(self, logs: Path, path: Path, endpoint: str) -> None:
        self._logs = logs
        self.path = path
        self.bus = BusConfig(endpoint=endpoint)
        self._stack = ExitStack()

    def __enter__(self) -> "Server":
        self._stack.enter_context(open_router(self.bus))
        self.listener = Listener(self._stack.enter_context(open_bus(self.bus)))
        self.start()
        return self

    def start(self) -> None:
        served = Process(self._logs, "serve", self.path, "--endpoint", self.bus.endpoint)
        self.process = self._stack.enter_context(served)
        wait_until(lambda: self.listener.alive("mapserver"), "the map is served")

    def kill(self) -> None:
        self.process.stop(signal.SIGKILL)

    def fetch(self, to: Path) -> Process:
        name = self.path.stem
        return Process(self._logs, "fetch", name, "--to", to, "--endpoint", self.bus.endpoint)

    def chunks_sent(self) -> int:
        return self.listener.count("mapserver", "chunks")

    def __exit__(self, *_: object) -> None:
        self._stack.close()


@pytest.fixture
def server(logs: Path, large_path: Path, endpoint: str) -> Iterator[Server]:
    with Server(logs, large_path, endpoint) as serving:
        yield serving


def arrived(to: Path) -> int:
    """Return how many bytes of the largest file have arrived."""
    file = to / "large.pfmap.partial" / "places" / "thumbnails.npy"
    return file.stat().st_size if file.is_file() else 0


@contextmanager
def in_the_middle(server: Server, to: Path, share: float = 0.2) -> Iterator[Process]:
    """Fetch, and stop when so much of it has arrived."""
    with server.fetch(to) as fetch:
        wait_until(lambda: arrived(to) > share * LONG * CHUNK, "a part has arrived")
        assert fetch.runs, fetch.err
        yield fetch


def content(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


def ended_well(fetch: Process) -> bool:
    wait_until(lambda: not fetch.runs, "the map is fetched")
    return fetch.stop() == 0


def test_a_fetch_that_was_killed_continues_with_the_rest(server: Server, tmp_path: Path) -> None:
    chunks = OwnMap(server.path).offer().chunks
    with in_the_middle(server, tmp_path) as fetch:
        fetch.stop(signal.SIGKILL)
    assert not (tmp_path / "large.pfmap").exists()
    files = (tmp_path / "large.pfmap.partial").rglob("*.npy")
    kept = sum(-(-file.stat().st_size // CHUNK) for file in files)
    if arrived(tmp_path) % CHUNK:
        kept -= 1
    sent = _smoothed(server)
    with server.fetch(tmp_path) as fetch:
        assert ended_well(fetch), fetch.err
        assert fetch.out == f"{tmp_path}/large.pfmap: 60 places, 3 channels\n"
    assert _smoothed(server) - sent == chunks - kept < 0.9 * chunks
    assert os.listdir(tmp_path) == ["large.pfmap"]
    assert content(tmp_path / "large.pfmap") == content(server.path)


def _smoothed(server: Server) -> int:
    """Return how many chunks were sent once that no longer changes."""
    before = -1
    while (sent := server.chunks_sent()) != before:
        before = sent
        _await_two_counts(server)
    return sent


def _await_two_counts(server: Server) -> None:
    """Wait until the counts have been published anew."""
    received: list[str] = []
    server.listener.bus.subscribe_raw(
        server.listener.keys.all_stats, lambda key, payload: received.append(key)
    )
    wait_until(lambda: len(received) > 1, "counts")


def test_a_fetch_survives_the_restart_of_its_server(server: Server, tmp_path: Path) -> None:
    with in_the_middle(server, tmp_path) as fetch:
        server.kill()
        with server.fetch(tmp_path) as second:
            wait_until(lambda: not second.runs, "another one at the same place is refused")
            assert "another process fetches it" in second.err
        server.start()
        assert ended_well(fetch), fetch.err
    assert content(tmp_path / "large.pfmap") == content(server.path)
    assert server.process.stop() == 0


def test_a_map_that_was_fetched_works_and_its_host_serves_it_on(
    host: Host, logs: Path, tmp_path: Path, map_path: Path, query_dir: Path
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    fetched = placefield("fetch", "route.pfmap", "--to", here, "--endpoint", host.endpoint)
    assert fetched.returncode == 0, fetched.stderr
    with Host(logs, here / "route.pfmap") as own, own.listener() as listener:
        own.replay(query_dir, "--stride", "6")
        assert len(listener.answers()) == 10
        again = placefield("fetch", "route", "--to", there, "--endpoint", own.endpoint)
        assert again.returncode == 0, again.stderr
    assert content(there / "route.pfmap") == content(map_path)


def test_without_room_or_without_a_server_one_line_says_so(
    host: Host, tmp_path: Path, map_path: Path
) -> None:
    def no_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    fetch = ("fetch", "route", "--to", tmp_path, "--endpoint", host.endpoint)
    line = refusal(placefield(*fetch, preexec=no_room))
    assert line.endswith("route.pfmap: cannot be fetched: the disk is full; free some space")
    line = refusal(placefield("fetch", "x", *fetch[2:], "--set", "bus.connect_timeout_s=0.5"))
    assert "x: nothing has come for 0.5 s: no host that has it answers" in line
    assert os.listdir(tmp_path) == ["route.pfmap.partial"]
