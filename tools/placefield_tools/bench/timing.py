"""Times of several ways of doing the same, measured in one run."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Timings:
    """Seconds that each way took in each round.

    Attributes:
        seconds: (rounds, ways) float64.
    """

    seconds: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        ways: Sequence[Callable[[], object]],
        *,
        rounds: int,
        clock: Callable[[], float] = time.perf_counter,
    ) -> Self:
        """Time the ways in turn, round after round.

        So a slow moment of the machine affects all of them.

        A first round warms up and is not counted.
        """
        timed = [[_seconds(way, clock) for way in ways] for _ in range(1 + rounds)]
        return cls(np.array(timed[1:]))

    def median(self, way: int) -> float:
        """Return the median seconds of a way."""
        return float(np.median(self.seconds[:, way]))

    def ratio(self, way: int, other: int) -> float:
        """Return how many times as long as the other a way takes: the median over the rounds."""
        return float(np.median(self.seconds[:, way] / self.seconds[:, other]))


def _seconds(way: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    way()
    return clock() - start
