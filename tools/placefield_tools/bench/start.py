"""Channel workers of a map of a gigabyte: how long they take to start, and what they share."""

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil  # type: ignore[import-untyped]

from placefield.bus.keys import Keys
from placefield.bus.session import Bus, open_router
from placefield.config import BusConfig, Config
from placefield.errors import BusError
from placefield.maps.manifest import SUFFIX
from placefield.maps.store import save_map
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.made import CHANNELS, made_map
from placefield_tools.bench.walks import random_walk
from placefield_tools.hosting import free_endpoint

_PLACES, _DIMENSIONS = 400_000, 300  # 2 bytes each, 4 metrics: 0.96 GB
_WORKERS = 8
_STARTS = 5
_PATIENCE_S = 120.0

_ALL_CHANNELS = Keys(Config().run).all_alive("channel")


def bench_start() -> list[Figure]:
    """Start workers of all channels: one after the other, then eight at once."""
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        path = Path(folder) / f"large{SUFFIX}"
        save_map(made_map(random_walk(_PLACES, _DIMENSIONS, seed=0)), path)
        endpoint = free_endpoint()
        with open_router(BusConfig(endpoint=endpoint)) as bus:
            starts = [_start_s(bus, path, endpoint) for _ in range(1 + _STARTS)]
            with ExitStack() as stack:
                workers = [stack.enter_context(_worker(path, endpoint)) for _ in range(_WORKERS)]
                _await_channels(bus, _WORKERS * CHANNELS)
                memory = [psutil.Process(worker.pid).memory_full_info() for worker in workers]
    return [
        Figure(
            "start_s", statistics.median(starts[1:]), "a worker's start, map of 1 GB", at_most=2
        ),
        Figure(
            "workers_rss_gb",
            sum(of_worker.rss for of_worker in memory) / 1e9,
            f"memory of {_WORKERS} workers, each by itself (RSS)",
        ),
        Figure(
            "workers_pss_gb",
            sum(of_worker.pss for of_worker in memory) / 1e9,
            "what they share counted once (PSS)",
        ),
    ]


def _start_s(bus: Bus, path: Path, endpoint: str) -> float:
    start = time.perf_counter()
    with _worker(path, endpoint):
        _await_channels(bus, CHANNELS)
        return time.perf_counter() - start


@contextmanager
def _worker(path: Path, endpoint: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "placefield_tools", "channel", str(path)]
    command += [flag for channel in range(CHANNELS) for flag in ("--channel", str(channel))]
    with subprocess.Popen([*command, "--endpoint", endpoint]) as process:
        try:
            yield process
        finally:
            process.terminate()


def _await_channels(bus: Bus, count: int) -> None:
    end = time.perf_counter() + _PATIENCE_S
    while len(bus.alive(_ALL_CHANNELS)) < count:
        if time.perf_counter() > end:
            raise BusError(f"the workers did not start within {_PATIENCE_S:g} s; see above")
        time.sleep(0.01)
