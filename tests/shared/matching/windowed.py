"""The rules that compare windows, on distances that are made up, for tests of the rules."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from comparisons import comparison_at, metric_of_quantized
from numpy.typing import NDArray

from placefield.matching.candidate import Candidate
from placefield.matching.matcher import SmoothedCandidate
from placefield.matching.window_matcher import ShardPlaces, WindowMatcher

NOWHERE = metric_of_quantized(np.zeros((1, 1), np.int16), 1.0)
"""Stands for the metric of made-up distances."""


def mean_of(distances: NDArray[np.int32]) -> int:
    """Return the mean of distances (K,), rounded half to even."""
    return round(Fraction(int(distances.sum(dtype=np.int64)), len(distances)))


class Windowed:
    """A whole channel that is given its distances."""

    def __init__(
        self,
        rule: type[WindowMatcher],
        lengths: Sequence[int],
        places: int,
        unit: float = 1.0,
        lag: int = 0,
    ) -> None:
        every = slice(0, places)
        whole = ShardPlaces(places, every, every)
        self.matcher = rule(lengths, whole, unit, lambda _: mean_of(self._distances), [lag])
        self._distances = np.zeros(places, np.int32)

    def update(self, distances: NDArray[np.int32]) -> Candidate:
        """Return the candidate for a frame at these distances (K,)."""
        self._distances = distances
        return self.matcher.update(comparison_at(NOWHERE, np.zeros(1, np.int16), distances))

    def update_missing(self) -> Candidate:
        """Return the candidate for a missing observation."""
        return self.matcher.update(None)

    def update_all(self, frames: Sequence[NDArray[np.int32] | None]) -> list[Candidate]:
        """Return the candidates for frames at these distances (K,), None for a missing one."""
        return [self.update_missing() if each is None else self.update(each) for each in frames]

    def smooth_all(self, frames: Sequence[NDArray[np.int32] | None]) -> list[SmoothedCandidate]:
        """Return the smoothed candidates of a whole stream."""
        smoothed = []
        for frame in frames:
            self.update_all([frame])
            smoothed += self.matcher.smoothed()
        smoothed += self.finish()
        return [
            each._replace(lag=min(each.lag, len(frames) - 1 - number))
            for number, each in enumerate(smoothed[: len(frames)])
        ]

    def finish(self) -> list[SmoothedCandidate]:
        """Return the candidates that are smoothed at the end of a stream."""
        smoothed = []
        for _ in range(self.matcher.tail):
            self.update_missing()
            smoothed += self.matcher.smoothed()
        return smoothed + self.matcher.finish()
