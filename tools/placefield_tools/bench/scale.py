"""Maps of a thousand to a million places: what a frame costs, and what memory it takes."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.bus.session import open_bus
from placefield.config import BusConfig, Config
from placefield.fusion.match import Match
from placefield.maps.manifest import SUFFIX
from placefield.maps.map import fingerprint
from placefield.maps.store import save_map
from placefield_tools.bench.feeding import Feeder
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.host_chain import started
from placefield_tools.bench.random_walks import drive_along, observed_again, random_walk
from placefield_tools.bench.shard_parts import shard_parts
from placefield_tools.bench.shard_speed import bench_shards
from placefield_tools.bench.start import bench_start
from placefield_tools.bench.synthetic import made_channel, made_map
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.common.progress import tracked

SIZES = (1_000, 10_000, 100_000, 1_000_000)
DIMENSIONS = 300
_FRAMES = 300
_WARM_UP = 20  # frames
_LIGHT = 0.8  # how strong the noise is that sets the query apart
_SHARDED = 100_000
_PARTS_OF = 60  # frames
_BARS = {100_000: 30.0, 1_000_000: 10.0}  # frames per second

Array = NDArray[np.float32]


def bench_scale() -> list[Figure]:
    """Measure channel workers and fuser on synthetic descriptors, in place of a featurizer.

    Each channel has its own metric, as if it had been learned; there is one worker per core. A map
    with a coarse search is also measured with the exact search.
    """
    walk = random_walk(max(SIZES), DIMENSIONS, seed=0)
    figures: list[Figure] = []
    with tracked(SIZES, "maps", len(SIZES)) as sizes:
        for size in sizes:
            figures += _figures_of(walk[:size])
    return [*figures, *bench_start()]


def _figures_of(walk: Array) -> list[Figure]:
    size, config = len(walk), Config()
    drive = drive_along(size, _FRAMES, seed=1)
    query = list(observed_again(walk[drive], _LIGHT, seed=2))
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        path = Path(folder) / f"walk{SUFFIX}"
        placemap = made_map(walk, coarse=size >= config.build.coarse_from)
        model = fingerprint(placemap.model)
        save_map(placemap, path)
        del placemap
        matches, seconds, gigabytes = _run(path, model, query)
        figures = [
            Figure(
                f"frames_per_s_{size}",
                _FRAMES / seconds,
                f"{size:,} places: frames per second",
                at_least=_BARS.get(size),
            ),
            Figure(f"frame_ms_{size}", 1e3 * seconds / _FRAMES, "milliseconds a frame"),
            Figure(
                f"resident_gb_{size}",
                gigabytes,
                "resident memory of all services, GB",
                at_most=4 if size == max(SIZES) else None,
            ),
            Figure(f"right_{size}", _right(matches, drive), "share of matches that is right"),
        ]
        if size == _SHARDED:
            figures += bench_shards(path, model, query, matches)
            figures += shard_parts(made_channel(walk, 0), query[:_PARTS_OF])
        if size >= config.build.coarse_from:
            figures += _beside_exact(size, path, model, query, matches)
    return figures


def _beside_exact(
    size: int, path: Path, model: str, query: list[Array], matches: Sequence[Match]
) -> list[Figure]:
    exact, seconds, gigabytes = _run(path, model, query, "--exact")
    same = np.mean([one.place == other.place for one, other in zip(matches, exact, strict=True)])
    return [
        Figure(f"agreement_{size}", float(same), "share with the same place", at_least=0.99),
        Figure(f"exact_frames_per_s_{size}", len(query) / seconds, "exact: frames per second"),
        Figure(f"exact_resident_gb_{size}", gigabytes, "exact: resident memory, GB"),
    ]


def _run(
    path: Path, model: str, query: list[Array], *flags: str
) -> tuple[list[Match], float, float]:
    """Match a query on a host of its own: the matches, the seconds, and the GB in its memory."""
    command = [*PLACEFIELD, "up", str(path), *flags]
    with (
        started([[*command, "--set", "fusion.deadline_s=60"]]) as [chain],
        open_bus(BusConfig(endpoint=chain.endpoint)) as bus,
    ):
        feeder = Feeder(bus, Config().run, model)
        feeder.feed(query[:_WARM_UP])
        matches, seconds = feeder.feed(query)
        return matches, seconds, chain.resident_bytes() / 1e9


def _right(matches: Sequence[Match], drive: NDArray[np.int64]) -> float:
    places = np.array([match.place for match in matches])
    return float(np.mean(np.abs(places - drive) <= Config().matching.tolerance))
