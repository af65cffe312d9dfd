"""Building a map of many places from given descriptors: time and memory of the command."""

import os
import tempfile
from pathlib import Path

import numpy as np

from placefield.maps.manifest import SUFFIX
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.random_walks import random_walk
from placefield_tools.bench.watched_command import watched
from placefield_tools.common.own_command import PLACEFIELD

_DIMENSIONS = 300
_LONGEST_S, _MOST_MB = 1200, 6000  # targets for a million places or fewer
_MILLION = 1_000_000


def described_build(places: int) -> list[Figure]:
    """Build a map of a random walk of so many places, with the default settings."""
    with tempfile.TemporaryDirectory(prefix="placefield-bench-") as name:
        file = Path(name) / "walk.npy"
        np.save(file, random_walk(places, _DIMENSIONS, seed=0))
        before = _processor_s()
        build = watched([*PLACEFIELD, "build", str(file), "-o", f"{name}/walk{SUFFIX}"])
        computed_s = _processor_s() - before
    has_target = places <= _MILLION
    what = f"{places:,} places of {_DIMENSIONS} numbers"
    return [
        Figure("build_s", build.seconds, what, at_most=_LONGEST_S if has_target else None),
        Figure("build_processor_s", computed_s, "the same: processor time of all cores"),
        Figure(
            "build_peak_mb",
            build.peak_mb,
            "the same: peak memory of the process, the mapped file too",
            at_most=_MOST_MB if has_target else None,
        ),
    ]


def _processor_s() -> float:
    """Return the processor time of all processes that have ended and were waited for."""
    used = os.times()
    return used.children_user + used.children_system
