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


class WindowMatcher(Matcher):
    """Compares windows at the speed of the reference, one per scale.

    A partial result is that of the backward windows of the newest frame. With a lag, that of the
    forward windows of the frame smoothed with it follows.
    """

    def __init__(
        self,
        lengths: Sequence[int],
        places: ShardPlaces,
        unit: float,
        mean_distance: Callable[[Quantized], int],
        lag: int,
    ) -> None:
        """Begin a stream.

        Args:
            lengths: of the windows.
            places: the shard's.
            unit: of the quantized descriptors; distances are in its square.
            mean_distance: of a frame (M,) to all places of the map, see ``MeanDistance``.
            lag: frames that forward windows may reach; longer windows are cut. With 0, the smoothed
                candidate is the immediate one.
        """
        self.horizon = max(lengths)
        self._places, self._reversed = places, places.reversed()
        self._unit, self._mean_distance = unit, mean_distance
        observed = places.observed.stop - places.observed.start
        self._recent = RecentDistances(self.horizon, observed)
        self._backward = WindowSums(self._recent, lengths)
        self._forward: WindowSums | None = None
        if lag > 0:
            cut = [min(length, lag + 1) for length in lengths]
            self._forward = WindowSums(self._recent, cut, forward=True)
        self.tail = self._forward.delay if self._forward else 0
        self._length = 0
        self._smoothed: list[SmoothedCandidate] = []

    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Move the windows on by a frame; a missing observation moves them on as well."""
        if frame is None:
            self._recent.update_missing()
        else:
            self._recent.update(frame.distances, self._mean_distance(frame.descriptor))
        self._backward.slide()
        partial = self._partial(self._backward, self._places)
        if self._forward:
            self._forward.slide()
            partial = np.concatenate([partial, self._partial(self._forward, self._reversed)])
        self._length = len(partial)
        return partial

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate for the last frame."""
        if self._forward is None:
            candidate = self._best(self._backward, self._places, partials)
            self._smoothed = [SmoothedCandidate(candidate, 0)]
            return candidate
        half = self._length // 2
        candidate = self._best(self._backward, self._places, [each[:half] for each in partials])
        self._smoothed = []
        if self._recent.frames > self._forward.delay:
            mirrored = [each[half:] for each in reversed(partials)]
            smoothed = self._best(self._forward, self._reversed, mirrored)
            self._smoothed = [
                SmoothedCandidate(smoothed.reversed(self._places.places), self._forward.delay)
            ]
        return candidate

    def fits(self, partial: Partial) -> bool:
        """Whether what came from another shard can be its partial result for this frame."""
        return len(partial) == self._length

    def smoothed(self) -> list[SmoothedCandidate]:
        """Return the frame whose longest forward window ends with the last frame, if any."""
        return self._smoothed

    def finish(self) -> list[SmoothedCandidate]:
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
