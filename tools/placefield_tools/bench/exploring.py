"""The cost of a frame while a drive is explored, and the memory of a place."""

import time

import numpy as np
import psutil  # type: ignore[import-untyped]
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.matching.exploring import Explorer
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.random_walks import random_walk

_DIMENSIONS = 512  # of GIST
_MEAN_OF = 100  # frames
_BUDGET_MS = 100.0  # of a frame, at 10 frames per second
_SHORT = 10  # the drive is measured after one of so many parts, too


def bench_explore(frames: int) -> list[Figure]:
    """Explore a drive of so many frames, each of which is a new place."""
    raws = random_walk(frames, _DIMENSIONS, seed=0)
    explorer = Explorer(MatchingConfig())
    short = frames // _SHORT
    before_ms = _explore(explorer, raws[:short])
    resident = psutil.Process().memory_info().rss
    after_ms = _explore(explorer, raws[short:])
    grown = psutil.Process().memory_info().rss - resident
    return [
        Figure("explore_ms", after_ms, f"a frame after {frames} places", at_most=_BUDGET_MS),
        Figure("explore_short_ms", before_ms, f"a frame after {short} places"),
        Figure(
            "explore_growth",
            after_ms / before_ms,
            f"how many times as long, with {_SHORT} times the places",
            at_most=_SHORT,
        ),
        Figure("explore_bytes", grown / (frames - short), "memory of a place, bytes"),
    ]


def _explore(explorer: Explorer, raws: NDArray[np.float32]) -> float:
    """Explore these frames; return the mean computing time of the last of them, milliseconds."""
    for raw in raws[:-_MEAN_OF]:
        _update(explorer, raw)
    start = time.process_time()
    for raw in raws[-_MEAN_OF:]:
        _update(explorer, raw)
    return (time.process_time() - start) / _MEAN_OF * 1e3


def _update(explorer: Explorer, raw: NDArray[np.float32]) -> None:
    explorer.update(raw)
    explorer.smoothed()
