"""The rules that compare windows of frames, in one shard of a channel.

The immediate candidate is by backward windows, which end at the frame and its place. The smoothed
one, some frames later, is by forward windows, which begin there, as published. Each is the mirror
image of the other: of the stream in reverse, on the map in reverse.

A window of a place in a shard may reach beyond the shard. So each shard compares as many more
places on either side as the longest window reaches, and has the same sums as the whole map, to the
last bit.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.maps.map import MapMetric
from placefield.matching.candidate import Candidate
from placefield.matching.comparing import Comparison
from placefield.matching.matcher import Matcher, Partial, SmoothedCandidate
from placefield.matching.windows import RecentDistances, WindowSums
from placefield.search.quantized import Quantized


class MeanDistance:
    """The mean squared distance of frames to all places of a map; it replaces missing distances."""

    def __init__(self, metric: MapMetric) -> None:
        """Prepare for the metric of a whole map; this reads all of its places."""
        self._places = len(metric.places)
        self._sum = metric.places.sum(axis=0, dtype=np.int64)
        self._squares = int(metric.squares.sum(dtype=np.int64))

    def __call__(self, descriptor: Quantized) -> int:
        """Return the mean of a frame, (M,) int16, rounded half to even, in squared units."""
        return _mean_distance(descriptor, self._places, self._squares, self._sum)


@kernel
def _mean_distance(
    descriptor: Quantized, places: int, squares: int, summed: NDArray[np.int64]
) -> int:
    """Return the mean distance, given the sums of the places' squared lengths and of the places."""
    square, product = 0, 0
    for m in range(len(descriptor)):
        square += int(descriptor[m]) * int(descriptor[m])
        product += int(descriptor[m]) * summed[m]
    return round((places * square + squares - 2 * product) / places)


@dataclass(frozen=True)
class ShardPlaces:
    """Which places of a map belong to a shard.

    Attributes:
        places: how many the map has.
        own: the shard's own.
        observed: its own, and those that windows reach on either side.
    """

    places: int
    own: slice
    observed: slice

    @classmethod
    def around(cls, places: int, own: slice, before: int, forward: int) -> "ShardPlaces":
        """Return the places of a shard whose windows reach so many places before and after."""
        observed = slice(max(own.start - before, 0), min(own.stop + forward, places))
        return cls(places, own, observed)

    @property
    def count(self) -> int:
        """How many places are the shard's own."""
        return int(self.own.stop - self.own.start)

    @property
    def skipped(self) -> int:
        """How many places are observed before the shard's own."""
        return int(self.own.start - self.observed.start)

    def reversed(self) -> "ShardPlaces":
        """Return the same places in the reversed map."""
        own, observed = (
            slice(self.places - part.stop, self.places - part.start)
            for part in (self.own, self.observed)
        )
        return ShardPlaces(self.places, own, observed)


def reach(longest: int, lag: int) -> int:
    """Return how many frames, and places, the forward windows reach."""
    return min(longest - 1, lag)


def _windows_ahead(recent: RecentDistances, lengths: Sequence[int], lag: int) -> WindowSums | None:
    """Return forward windows of these lengths that reach ``lag`` frames; None with lag 0."""
    if lag == 0:
        return None
    return WindowSums(recent, [min(length, lag + 1) for length in lengths], forward=True)


class WindowMatcher(Matcher):
    """Compares windows at the speed of the reference, one per scale.

    A partial result is that of the backward windows of the newest frame. For each lag that of the
    forward windows of the frame smoothed with it follows.
    """

    def __init__(
        self,
        lengths: Sequence[int],
        places: ShardPlaces,
        unit: float,
        mean_distance: Callable[[Quantized], int],
        lags: Sequence[int],
    ) -> None:
        """Begin a stream.

        Args:
            lengths: of the windows.
            places: the shard's.
            unit: of the quantized descriptors; distances are in its square.
            mean_distance: of a frame (M,) to all places of the map, see ``MeanDistance``.
            lags: frames that forward windows may reach; longer windows are cut. With 0, the
                smoothed candidate is the immediate one.
        """
        self.horizon = max(lengths)
        self._places, self._reversed = places, places.reversed()
        self._unit, self._mean_distance = unit, mean_distance
        observed = places.observed.stop - places.observed.start
        self._recent = RecentDistances(self.horizon, observed)
        self._backward = WindowSums(self._recent, lengths)
        self._forward = [_windows_ahead(self._recent, lengths, lag) for lag in lags]
        self.tail = max((each.delay for each in self._forward if each is not None), default=0)
        self._ends = [0]  # of the partial results of the windows, in one
        self._smoothed: list[list[SmoothedCandidate]] = [[] for _ in lags]

    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Move the windows on by a frame; a missing observation moves them on as well."""
        if frame is None:
            self._recent.update_missing()
        else:
            self._recent.update(frame.distances, self._mean_distance(frame.descriptor))
        self._backward.slide()
        parts = [self._partial(self._backward, self._places)]
        for forward in self._forward:
            if forward is not None:
                forward.slide()
                parts.append(self._partial(forward, self._reversed))
        self._ends = [*accumulate(len(part) for part in parts)]
        return np.concatenate(parts)

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate for the last frame."""
        own, *ahead = (
            [partial[start:end] for partial in partials]
            for start, end in pairwise([0, *self._ends])
        )
        candidate = self._best(self._backward, self._places, own)
        of_lags = iter(ahead)
        self._smoothed = [
            [SmoothedCandidate(candidate, 0)]
            if forward is None
            else self._smooth(forward, next(of_lags))
            for forward in self._forward
        ]
        return candidate

    def _smooth(self, forward: WindowSums, partials: Sequence[Partial]) -> list[SmoothedCandidate]:
        """Return the frame whose longest forward window ends with the newest frame, if any."""
        if self._recent.frames <= forward.delay:
            return []
        smoothed = self._best(forward, self._reversed, partials[::-1])
        return [SmoothedCandidate(smoothed.reversed(self._places.places), forward.delay)]

    def fits(self, partial: Partial) -> bool:
        """Whether what came from another shard can be its partial result for this frame."""
        return len(partial) == self._ends[-1]

    def smoothed(self, which: int = 0) -> list[SmoothedCandidate]:
        """Return the frame whose longest forward window ends with the last frame, if any."""
        return self._smoothed[which]

    def finish(self, which: int = 0) -> list[SmoothedCandidate]:
        """Return none: the tail has smoothed all frames, by windows that end with the stream."""
        return []

    @abstractmethod
    def _best(
        self, windows: WindowSums, places: ShardPlaces, partials: Sequence[Partial]
    ) -> Candidate:
        """Return the candidate by some windows, given the partial results of all shards.

        Windows, places, shards and the candidate are in one order: the map's, or its reverse.
        """

    @abstractmethod
    def _partial(self, windows: WindowSums, places: ShardPlaces) -> Partial:
        """Return the partial result of windows at the shard's places, (n,) float64."""
