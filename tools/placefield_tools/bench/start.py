"""Channel workers of a map of a gigabyte: their start time, and the memory they share."""

import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import psutil  # type: ignore[import-untyped]

from placefield.bus.connecting import open_router
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config
from placefield.errors import BusError
from placefield.maps.manifest import SUFFIX
from placefield.maps.map import fingerprint
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.random_walks import random_walk
from placefield_tools.bench.synthetic import CHANNELS, made_map
from placefield_tools.common.host_process import free_endpoint
from placefield_tools.common.own_command import PLACEFIELD

_PLACES, _DIMENSIONS = 400_000, 300  # 2 bytes each, 4 metrics: 0.96 GB
_WORKERS = 8
_STARTS = 5
_PATIENCE_S = 120.0

_KEYS = Keys(Config().run)


def bench_start() -> list[Figure]:
    """Start workers of all channels: one after the other, then eight at once."""
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        path = Path(folder) / f"large{SUFFIX}"
        save_map(made_map(random_walk(_PLACES, _DIMENSIONS, seed=0)), path)
        endpoint = free_endpoint()
        with open_router(BusConfig(endpoint=endpoint)) as bus:
            tokens = _ChannelTokens(bus)
            starts = [_start_s(tokens, path, endpoint) for _ in range(1 + _STARTS)]
            with ExitStack() as stack:
                workers = [stack.enter_context(_worker(path, endpoint)) for _ in range(_WORKERS)]
                tokens.wait_for(_WORKERS * CHANNELS)
                memory = _memory_after_a_frame(bus, path, [worker.pid for worker in workers])
    return [
        Figure(
            "start_s", statistics.median(starts[1:]), "a worker's start, map of 1 GB", at_most=1.5
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


class _ChannelTokens:
    """The tokens of channels that are ready."""

    def __init__(self, bus: Bus) -> None:
        self._alive: set[str] = set()
        self._changed = threading.Condition()
        bus.watch_alive(_KEYS.all_alive("channel"), self._change)

    def _change(self, key: str, is_alive: bool) -> None:
        with self._changed:
            (self._alive.add if is_alive else self._alive.discard)(key)
            self._changed.notify_all()

    def wait_for(self, count: int) -> None:
        """Wait until there are so many."""
        with self._changed:
            if not self._changed.wait_for(lambda: len(self._alive) == count, _PATIENCE_S):
                raise BusError(f"the workers did not start within {_PATIENCE_S:g} s; see above")


def _start_s(tokens: _ChannelTokens, path: Path, endpoint: str) -> float:
    tokens.wait_for(0)
    start = time.perf_counter()
    with _worker(path, endpoint):
        tokens.wait_for(CHANNELS)
        return time.perf_counter() - start


def _memory_after_a_frame(bus: Bus, path: Path, workers: Sequence[int]) -> list[Any]:
    """Return the memory of workers that have read all places, by their process numbers."""
    model = open_map(path, channels=()).model
    frame = FeatureMessage(model=fingerprint(model), descriptor=model.parts[0].components[0])
    bus.publisher(_KEYS.feature).put(Header(stream="start", sequence=0, stamp_ns=0), frame)
    size = sum(file.stat().st_size for file in path.glob("metrics/*/places.npy"))
    end = time.perf_counter() + _PATIENCE_S
    while min(psutil.Process(worker).memory_info().rss for worker in workers) < size:
        if time.perf_counter() > end:
            raise BusError(f"the workers did not read the map within {_PATIENCE_S:g} s")
        time.sleep(0.1)
    return [psutil.Process(worker).memory_full_info() for worker in workers]


@contextmanager
def _worker(path: Path, endpoint: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [*PLACEFIELD, "channel", str(path)]
    command += [flag for channel in range(CHANNELS) for flag in ("--channel", str(channel))]
    with subprocess.Popen([*command, "--endpoint", endpoint]) as process:
        try:
            yield process
        finally:
            process.terminate()
