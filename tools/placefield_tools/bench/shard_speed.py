"""A map's places spread over workers, beside the same map whole."""

import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys
from placefield.config import BusConfig, Config
from placefield.errors import BusError
from placefield.fusion.match import Match
from placefield_tools.bench.feeding import Feeder
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.host_chain import default_environment, started
from placefield_tools.bench.synthetic import CHANNELS
from placefield_tools.common.own_command import PLACEFIELD

SHARDS = 4

_PATIENCE_S = 120.0


def bench_shards(
    path: Path, model: str, query: Sequence[NDArray[np.float32]], whole: Sequence[Match]
) -> list[Figure]:
    """Match a query in shards of a map, a worker each, and compare with what the whole gives."""
    with _sharded(path) as endpoint, open_bus(BusConfig(endpoint=endpoint)) as bus:
        matches, seconds = Feeder(bus, Config().run, model).feed(query)
    pairs = list(zip(matches, whole, strict=True))
    same = np.mean([(one.place, one.known) == (other.place, other.known) for one, other in pairs])
    apart = max(abs(one.score - other.score) for one, other in pairs)
    name = f"in {SHARDS} shards"
    return [
        Figure("sharded_agreement", float(same), f"{name}: share of equal matches", at_least=1),
        Figure("sharded_score_apart", apart, f"{name}: how far scores are apart, at most"),
        Figure("sharded_frames_per_s", len(query) / seconds, f"{name}: frames per second"),
    ]


@contextmanager
def _sharded(path: Path) -> Iterator[str]:
    """Run router, fuser and a worker for each shard of all channels; yields the endpoint."""
    with started([[*PLACEFIELD, "router"]]) as [router]:
        channels = [part for number in range(CHANNELS) for part in ("--channel", str(number))]
        services = [["fuser", str(path), "--set", "fusion.deadline_s=60"]]
        for shard in range(SHARDS):
            services.append(["channel", str(path), *channels, "--shard", f"{shard}/{SHARDS}"])
        processes = [
            subprocess.Popen(
                [*PLACEFIELD, *service, "--endpoint", router.endpoint], env=default_environment()
            )
            for service in services
        ]
        try:
            _await_fuser(router.endpoint)
            yield router.endpoint
        finally:
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait()


def _await_fuser(endpoint: str) -> None:
    """Wait for the fuser, which waits for all channels."""
    fuser, end = Keys(Config().run).all_alive("fuser"), time.monotonic() + _PATIENCE_S
    with open_bus(BusConfig(endpoint=endpoint)) as bus:
        while not bus.alive(fuser):
            if time.monotonic() > end:
                raise BusError(f"the shards did not start within {_PATIENCE_S:g} s; see above")
            time.sleep(0.1)
