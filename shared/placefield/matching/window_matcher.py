"""The rules that compare windows of frames, in one shard of a channel.

The answer at once is by windows that end at the frame and its place; the smoothed one, some frames
later, by windows that begin there, as published. Either is the other's mirror image: of the stream
in reverse, on the map in reverse.

A window of a place in a shard may reach beyond it. So each observes as many places on either side
of its own as the longest window reaches, and has the same sums as the whole map, to the last bit.
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
from placefield.search.quantized import Codes


class MeanDistance:
    """The mean squared distance of frames to all places of a map, which windows fall back on."""

    def __init__(self, metric: MapMetric) -> None:
        """Take the whole map's metric; this reads all of its places."""
        self._places = len(metric.places)
        self._codes = metric.places.sum(axis=0, dtype=np.int64)
        self._squares = int(metric.squares.sum(dtype=np.int64))

    def __call__(self, codes: Codes) -> int:
        """Return that of a frame's codes (M,) int16, rounded half to even, in squared units."""
        return _mean_distance(codes, self._places, self._squares, self._codes)


@kernel
def _mean_distance(codes: Codes, places: int, squares: int, summed: NDArray[np.int64]) -> int:
    """Average the distances to places, by how many, their squared lengths' sum, and their sum."""
    square, product = 0, 0
    for m in range(len(codes)):
        square += int(codes[m]) * int(codes[m])
        product += int(codes[m]) * summed[m]
    return round((places * square + squares - 2 * product) / places)


@dataclass(frozen=True)
class ShardPlaces:
    """Which places of a map are a shard's.

    Attributes:
        places: how many the map has.
        own: the shard's.
        observed: those, and what windows reach on either side.
    """

    places: int
    own: slice
    observed: slice

    @classmethod
    def around(cls, places: int, own: slice, back: int, ahead: int) -> "ShardPlaces":
        """Return the places of a shard whose windows reach so far back, and ahead."""
        observed = slice(max(own.start - back, 0), min(own.stop + ahead, places))
        return cls(places, own, observed)

    @property
    def count(self) -> int:
        """How many are its own."""
        return int(self.own.stop - self.own.start)

    @property
    def skipped(self) -> int:
        """How many are observed before its own."""
        return int(self.own.start - self.observed.start)

    def turned(self) -> "ShardPlaces":
        """Return the same in the map in reverse."""
        own, observed = (
            slice(self.places - part.stop, self.places - part.start)
            for part in (self.own, self.observed)
        )
        return ShardPlaces(self.places, own, observed)


def reach(longest: int, lag: int) -> int:
    """Return how many frames after one, and places after its own, its windows look ahead."""
    return min(longest - 1, lag)


class WindowMatcher(Matcher):
    """Compares windows at the speed of the reference, one per scale.

    A partial result is that of the windows that look back from the newest frame, and then, with a
    lag, of those that look ahead from the one that is smoothed with it.
    """

    def __init__(
        self,
        lengths: Sequence[int],
        places: ShardPlaces,
        unit: float,
        mean_distance: Callable[[Codes], int],
        lag: int,
    ) -> None:
        """Begin a stream.

        Args:
            lengths: of the windows.
            places: the shard's.
            unit: that distances are in the square of.
            mean_distance: of a frame's codes (M,) to all places of the map, see ``MeanDistance``.
            lag: frames that the windows which begin at a frame may look ahead; longer ones are cut.
                With 0, the answer at once is all there is.
        """
        self.memory = max(lengths)
        self._places, self._turned = places, places.turned()
        self._unit, self._mean_distance = unit, mean_distance
        observed = places.observed.stop - places.observed.start
        self._recent = RecentDistances(self.memory, observed)
        self._back = WindowSums(self._recent, lengths)
        self._ahead: WindowSums | None = None
        if lag > 0:
            cut = [min(length, lag + 1) for length in lengths]
            self._ahead = WindowSums(self._recent, cut, ahead=True)
        self.tail = self._ahead.delay if self._ahead else 0
        self._length = 0
        self._smoothed: list[SmoothedCandidate] = []

    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Move the windows on; missing observations keep the others on their diagonal."""
        if frame is None:
            self._recent.update_missing()
        else:
            self._recent.update(frame.distances, self._mean_distance(frame.codes))
        self._back.slide()
        partial = self._partial(self._back, self._places)
        if self._ahead:
            self._ahead.slide()
            partial = np.concatenate([partial, self._partial(self._ahead, self._turned)])
        self._length = len(partial)
        return partial

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate for the last frame."""
        if self._ahead is None:
            candidate = self._best(self._back, self._places, partials)
            self._smoothed = [SmoothedCandidate(candidate, 0)]
            return candidate
        half = self._length // 2
        candidate = self._best(self._back, self._places, [each[:half] for each in partials])
        self._smoothed = []
        if self._recent.frames > self._ahead.delay:
            mirrored = [each[half:] for each in reversed(partials)]
            smoothed = self._best(self._ahead, self._turned, mirrored)
            self._smoothed = [
                SmoothedCandidate(smoothed.turned(self._places.places), self._ahead.delay)
            ]
        return candidate

    def fits(self, partial: Partial) -> bool:
        """Whether what came from another shard can be its partial result for this frame."""
        return len(partial) == self._length

    def smoothed(self) -> list[SmoothedCandidate]:
        """Return the frame whose longest window ends with the last one, if there is one."""
        return self._smoothed

    def finish(self) -> list[SmoothedCandidate]:
        """Return none: the tail has smoothed all frames, by windows that end with the stream."""
        return []

    @abstractmethod
    def _best(
        self, windows: WindowSums, places: ShardPlaces, partials: Sequence[Partial]
    ) -> Candidate:
        """Return the candidate by some windows, given the partial results of all shards.

        Windows, places, shards and the candidate are in one order: the map's, or the reverse.
        """

    @abstractmethod
    def _partial(self, windows: WindowSums, places: ShardPlaces) -> Partial:
        """Return what windows of the shard's places say of their frame, (n,) float64."""
