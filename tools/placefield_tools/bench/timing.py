"""Times of several ways of doing the same, measured in one run."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from placefield_tools.bench.ratio import Ratio

LIMIT_S = 60.0
"""After so long, no further round of a comparison begins."""

_LEAST_ROUNDS = 6  # fewer give a median no 95 % interval

Clock = Callable[[], float]

Pairs = Sequence[tuple[int, int]]
"""The ratios that are asked for: numbers of two ways each."""


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
        compared: Pairs = (),
        limit_s: float = LIMIT_S,
        clock: Clock = time.perf_counter,
    ) -> Self:
        """Time the ways in turn, round after round, see ``repeat``.

        A first round warms up and is not counted.
        """

        def round_of_all() -> list[float]:
            return [_seconds(way, clock) for way in ways]

        round_of_all()
        return cls(repeat(round_of_all, compared, limit_s=limit_s, clock=clock))

    def median(self, way: int) -> float:
        """Return the median seconds of a way."""
        return float(np.median(self.seconds[:, way]))

    def ratio(self, way: int, other: int) -> Ratio:
        """Return how many times as long as the other a way takes."""
        return Ratio.of(self.seconds[:, way], self.seconds[:, other])


def repeat(
    measure: Callable[[], Sequence[float]],
    compared: Pairs,
    *,
    limit_s: float = LIMIT_S,
    clock: Clock = time.perf_counter,
) -> NDArray[np.float64]:
    """Measure rounds until the interval of each ratio is narrow, or the time is over.

    There are six rounds or more, unless the time is over.

    Args:
        measure: measures every way once, in turn, so that a slow moment of the machine affects all
            of them.
        compared: the ways whose ratios are asked for.
        limit_s: seconds after which no further round begins.
        clock: seconds.

    Returns:
        What was measured, (rounds, ways).
    """
    end, rounds = clock() + limit_s, [measure()]
    while clock() < end and not _is_enough(np.array(rounds), compared):
        rounds.append(measure())
    return np.array(rounds, np.float64)


def _is_enough(rounds: NDArray[np.float64], compared: Pairs) -> bool:
    return len(rounds) >= _LEAST_ROUNDS and all(
        Ratio.of(rounds[:, one], rounds[:, other]).is_narrow for one, other in compared
    )


def _seconds(way: Callable[[], object], clock: Clock) -> float:
    start = clock()
    way()
    return clock() - start
