"""Maps of a thousand to ten million places: what a frame costs, and what memory it takes."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig, Config
from placefield.fusion.match import Match
from placefield.maps.manifest import SUFFIX
from placefield.maps.map import Map, fingerprint
from placefield.maps.map_metrics import identity_of_quantized
from placefield.maps.store import save_map
from placefield.search.quantized import DESCRIPTOR_UNIT
from placefield_tools.bench.feeding import Feeder
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.host_chain import started
from placefield_tools.bench.random_walks import (
    drive_along,
    observed_again,
    random_walk,
    write_random_walk,
)
from placefield_tools.bench.shard_parts import shard_parts
from placefield_tools.bench.shard_speed import bench_shards
from placefield_tools.bench.start import bench_start
from placefield_tools.bench.synthetic import made_channel, made_map, map_of_one_metric
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.common.progress import tracked

SIZES = (1_000, 10_000, 100_000, 1_000_000)
DIMENSIONS = 300
_FRAMES = 300
_WARM_UP = 20  # frames
_LIGHT = 0.8  # how strong the noise is that sets the query apart
_SHARDED = 100_000
_PARTS_OF = 60  # frames
_BARS = {100_000: 30.0, 1_000_000: 25.0, 10_000_000: 10.0}  # frames per second
_MOST_GB = {1_000_000: 3.0, 10_000_000: 8.0}  # resident memory of all services

Array = NDArray[np.float32]


def bench_scale(places: int | None = None) -> list[Figure]:
    """Measure channel workers and fuser on synthetic descriptors, in place of a featurizer.

    There is one worker per core. A map with a coarse search is also measured with the exact search.

    Args:
        places: of the only map, whose channels share one metric; None: maps of ``SIZES``, where
            each channel has its own metric, as if it had been learned.
    """
    if places is not None:
        return _of_one_metric(places)
    walk = random_walk(max(SIZES), DIMENSIONS, seed=0)
    figures: list[Figure] = []
    with tracked(SIZES, "maps", len(SIZES)) as sizes:
        for size in sizes:
            figures += _of_own_metrics(walk[:size])
    return [*figures, *bench_start()]


def _of_own_metrics(walk: Array) -> list[Figure]:
    size = len(walk)
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        path, drive = Path(folder) / f"walk{SUFFIX}", drive_along(size, _FRAMES, seed=1)
        placemap = made_map(walk, coarse=_is_coarse(size))
        figures = _figures_of(placemap, path, walk[drive], drive)
    if size == _SHARDED:
        query = list(observed_again(walk[drive], _LIGHT, seed=2))
        figures += shard_parts(made_channel(walk, 0), query[:_PARTS_OF])
    return figures


def _of_one_metric(size: int) -> list[Figure]:
    """Measure a map that is written block by block, because its floats may not fit in memory."""
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        path, drive = Path(folder) / f"walk{SUFFIX}", drive_along(size, _FRAMES, seed=1)
        file, shape = Path(folder) / "walk.npy", (size, DIMENSIONS)
        walk = np.lib.format.open_memmap(file, "w+", np.int16, shape)
        write_random_walk(walk, seed=0)
        seen = walk[drive] * np.float32(DESCRIPTOR_UNIT)
        placemap = map_of_one_metric(identity_of_quantized(walk, coarse=_is_coarse(size)))
        return _figures_of(placemap, path, seen, drive)


def _is_coarse(size: int) -> bool:
    return size >= Config().build.coarse_from


def _figures_of(placemap: Map, path: Path, seen: Array, drive: NDArray[np.int64]) -> list[Figure]:
    """Measure a map that is saved at a path, on a drive along these places, which look so."""
    size, model = placemap.places.count, fingerprint(placemap.model)
    query = list(observed_again(seen, _LIGHT, seed=2))
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
            at_most=_MOST_GB.get(size),
        ),
        Figure(f"right_{size}", _right(matches, drive), "share of matches that is right"),
    ]
    if size == _SHARDED:
        figures += bench_shards(path, model, query, matches)
    if _is_coarse(size):
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
