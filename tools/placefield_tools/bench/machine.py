"""How busy and how fast the machine is while something is measured."""

import ctypes
import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import numpy as np
import psutil  # type: ignore[import-untyped]
from threadpoolctl import threadpool_limits

from placefield_tools.bench.figure import Figure
from placefield_tools.bench.timing import Timings

_READ = (4096, 8192)  # float32, 134 MB: more than a cache holds
_PRODUCT = 1024  # rows and columns

_ENDING_S = 2.0  # of a process that was told to end
_SET_CHILD_SUBREAPER = 36  # of Linux, <linux/prctl.h>


def with_machine(measure: Callable[[], list[Figure]]) -> list[Figure]:
    """Return the figures that are measured, and those of the machine before, meanwhile, after."""
    _adopt_orphans()
    before, start = _Speed.now(), _Moment.now()
    figures = measure()
    _await_children()
    others, after = _Moment.now().others_since(start), _Speed.now()
    return [
        *figures,
        Figure("machine_others", others, "share of all cores that others took meanwhile"),
        *before.figures("before"),
        *after.figures("after"),
    ]


def _adopt_orphans() -> None:
    """Become the parent of all descendants whose own parent ends.

    A host's services are forked by a process that nobody awaits, so that their computing time would
    count as that of others. Only Linux offers this, by ``prctl``; Python has no function for it.
    """
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def _await_children() -> None:
    """Await all children that end now: only then their computing time counts as this process's."""
    psutil.wait_procs(psutil.Process().children(), timeout=_ENDING_S)


@dataclass(frozen=True)
class _Speed:
    """What one core reads, and computes with float32."""

    gb_per_s: float
    gflops: float

    @classmethod
    def now(cls) -> Self:
        """Measure it, for about a second."""
        read, vector = np.ones(_READ, np.float32), np.ones(_READ[1], np.float32)
        square = np.ones((_PRODUCT, _PRODUCT), np.float32)
        with threadpool_limits(1):
            times = Timings.of([lambda: read @ vector, lambda: square @ square])
        return cls(1e-9 * read.nbytes / times.median(0), 2e-9 * _PRODUCT**3 / times.median(1))

    def figures(self, when: str) -> list[Figure]:
        what = f"by one core, {when} the benchmark"
        return [
            Figure(f"machine_gb_per_s_{when}", self.gb_per_s, f"memory read {what}"),
            Figure(f"machine_gflops_{when}", self.gflops, f"float32 product {what}"),
        ]


@dataclass(frozen=True)
class _Moment:
    """Seconds of a clock, of all cores without work, and of this process and those it awaited."""

    clock: float
    idle: float
    own: float

    @classmethod
    def now(cls) -> Self:
        cores = psutil.cpu_times()
        return cls(time.perf_counter(), cores.idle + cores.iowait, sum(os.times()[:4]))

    def others_since(self, start: "_Moment") -> float:
        """Return the share of all cores that other processes and virtual machines took, 0 to 1."""
        free = self.idle - start.idle + self.own - start.own
        share = 1 - free / (psutil.cpu_count() * (self.clock - start.clock))
        return max(0.0, float(share))  # the counters have steps of 10 ms
