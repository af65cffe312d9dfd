"""The cost of a frame while a drive is explored, and the memory of a place."""

import time
from collections.abc import Callable
from itertools import count

import numpy as np
import psutil  # type: ignore[import-untyped]
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.matching.exploring import Explorer
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.random_walks import random_walk
from placefield_tools.bench.timing import Timings

_DIMENSIONS = 512  # of GIST
_IN_TURN = 10  # frames
_BUDGET_MS = 100.0  # of a frame, at 10 frames per second
_SHORT = 10  # a drive of one of so many parts is measured in turn with the whole


def bench_explore(frames: int) -> list[Figure]:
    """Explore a drive of so many frames and a part of it; each frame is a new place."""
    raws = random_walk(frames, _DIMENSIONS, seed=0)
    before, after = Explorer(MatchingConfig()), Explorer(MatchingConfig())
    short = frames // _SHORT
    _explore(before, raws[:short])
    _explore(after, raws[:short])
    resident = psutil.Process().memory_info().rss
    _explore(after, raws[short:])
    grown = psutil.Process().memory_info().rss - resident
    times = Timings.of(
        [_farther(before), _farther(after)], compared=[(1, 0)], clock=time.process_time
    )
    before_ms, after_ms = (1e3 * times.median(way) / _IN_TURN for way in range(2))
    return [
        Figure("explore_ms", after_ms, f"a frame after {frames} places", at_most=_BUDGET_MS),
        Figure("explore_short_ms", before_ms, f"a frame after {short} places"),
        Figure(
            "explore_growth",
            times.ratio(1, 0),
            f"how many times as long, with {_SHORT} times the places",
            at_most=_SHORT,
        ),
        Figure("explore_bytes", grown / (frames - short), "memory of a place, bytes"),
    ]


def _farther(explorer: Explorer) -> Callable[[], None]:
    """Return what explores some more frames, which are new places, at each call."""
    seeds = count(1)
    return lambda: _explore(explorer, random_walk(_IN_TURN, _DIMENSIONS, seed=next(seeds)))


def _explore(explorer: Explorer, raws: NDArray[np.float32]) -> None:
    for raw in raws:
        explorer.update(raw)
        explorer.smoothed()
