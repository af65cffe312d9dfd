"""Several runs through one set of services."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from hosting import UNREADABLE, Host, Listener, answers_of, offline, placefield, refusal, wait_until

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig, Config
from placefield.features.frames import Frame
from placefield.maps.map import Map
from placefield_tools.common.parallel import cores
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import Source

RUNS = ("day", "night")


@pytest.fixture(scope="module")
def shared_host(logs: Path, map_path: Path) -> Iterator[Host]:
    """A host that serves two runs."""
    flags = [flag for run in RUNS for flag in ("--run", run)]
    # A deadline as long as the test: a machine that is busy with others misses none of its own.
    flags += ["--set", "fusion.deadline_s=60"]
    with Host(logs, map_path, "--workers", "2", *flags) as running:
        yield running


@pytest.fixture
def listeners(shared_host: Host) -> Iterator[dict[str, Listener]]:
    with ExitStack() as stack:
        yield {run: stack.enter_context(shared_host.listener(run)) for run in RUNS}


def test_two_runs_share_the_workers_and_each_core_a_featurizer_and_fuser(shared_host: Host) -> None:
    assert shared_host.out.startswith("ready: runs 'day', 'night' at ")
    groups = min(2, cores())
    assert len(shared_host.children()) == cores() + 2 * groups + 1  # the map server


def test_two_runs_at_once_give_each_what_it_gives_alone(
    shared_host: Host,
    listeners: dict[str, Listener],
    route_map: Map,
    query_dir: Path,
    damaged_dir: Path,
) -> None:
    folders = {"day": query_dir, "night": damaged_dir}
    with ThreadPoolExecutor() as both:
        replays = [
            both.submit(shared_host.replay, folder, "--rate", "60", "--run", run)
            for run, folder in folders.items()
        ]
        assert all("60 frames replayed" in replayed.result().stdout for replayed in replays)
    for run, folder in folders.items():
        answers = answers_of(listeners[run].answers())
        assert answers == offline(route_map, sorted(folder.iterdir()))
    wait_until(
        lambda: listeners["night"].count("featurizer", "unreadable") == len(UNREADABLE),
        "the night's unreadable frames are counted",
    )
    assert not listeners["day"].count("featurizer", "unreadable")


class Flood(Source):
    """A camera that is far too fast."""

    count = None
    live = True

    def __init__(self, image: bytes) -> None:
        self._image = image

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        while True:
            yield Frame(index, index, f"frame {index}", self._image)
            index += 1


def test_a_run_that_floods_costs_another_not_one_frame(
    shared_host: Host, listeners: dict[str, Listener], route_map: Map, query_dir: Path
) -> None:
    files, stop = sorted(query_dir.iterdir()), threading.Event()
    config = Config(runs=("night",), bus=BusConfig(endpoint=shared_host.endpoint))
    flood = Flood(files[0].read_bytes())
    with open_bus(config.bus) as bus:
        flooding = threading.Thread(target=replay, args=(flood, bus, config, stop))
        flooding.start()
        try:
            listeners["night"].next_match()
            shared_host.replay(query_dir, "--run", "day")
            answers = answers_of(listeners["day"].answers())
        finally:
            stop.set()
            flooding.join()
    assert answers == offline(route_map, files)
    wait_until(lambda: listeners["night"].count("featurizer", "dropped_old"), "drops are counted")
    assert not listeners["day"].count("featurizer", "dropped_old")


def test_status_is_of_one_run(shared_host: Host) -> None:
    at = ("--endpoint", shared_host.endpoint)
    for run in RUNS:
        status = placefield("status", *at, "--run", run)
        assert status.returncode == 0, status.stderr
        assert f"run {run}" in status.stdout
        for service in ("featurizer", "fuser"):
            assert status.stdout.count(service) == 1
        assert status.stdout.count("channel") == 3
    line = refusal(placefield("status", *at, "--run", "day,night"))
    assert "give one of them with --run" in line


def test_a_service_of_two_runs_is_refused_where_one_of_them_has_it(
    shared_host: Host, map_path: Path
) -> None:
    flags = ("--endpoint", shared_host.endpoint, "--run", "dawn", "--run", "night")
    assert "run 'night' has a fuser already" in refusal(placefield("fuser", map_path, *flags))
