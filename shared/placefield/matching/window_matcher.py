"""The rules that compare windows of frames, in one shard of a channel.

A window that ends in a shard may begin before it. So each observes as many places before its own as
the longest window reaches back, and has the same sums as the whole map, to the last bit.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.maps.map import MapMetric
from placefield.matching.candidate import NO_CANDIDATE, Candidate
from placefield.matching.comparing import Comparison
from placefield.matching.matcher import Matcher, Partial, Settled
from placefield.matching.windows import WindowSums
from placefield.metric.codes import Codes


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


class WindowMatcher(Matcher):
    """Compares windows that end in a shard, at the speed of the reference; one per scale."""

    def __init__(
        self,
        windows: WindowSums,
        mean_distance: Callable[[Codes], int],
        observed: slice,
        own: slice,
    ) -> None:
        """Begin a stream.

        Args:
            windows: new ones, over the places that are observed.
            mean_distance: of a frame's codes (M,) to all places of the map, see ``MeanDistance``.
            observed: the shard's places, and those that windows reach back to, in the map.
            own: the shard's.
        """
        self._windows = windows
        self._mean_distance = mean_distance
        self._first_observed = observed.start
        self._first = own.start
        self._reached_back = own.start - observed.start
        self.memory = int(windows.row_lengths.max())
        self._length = 0
        self._candidate = NO_CANDIDATE

    def local(self, frame: Comparison | None) -> Partial:
        """Move the windows on; missing observations keep the others on their diagonal."""
        if frame is None:
            self._windows.push_unseen()
        else:
            self._windows.push(frame.distances, self._mean_distance(frame.codes))
        partial = self._partial()
        self._length = len(partial)
        return partial

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate for the last frame."""
        self._candidate = self._best(partials)
        return self._candidate

    def fits(self, partial: Partial) -> bool:
        """Whether what came from another shard can be its partial result for this frame."""
        return len(partial) == self._length

    def settled(self) -> list[Settled]:
        """Return the last frame."""
        return [Settled(self._candidate, 0)]

    def finish(self) -> list[Settled]:
        """Return nothing: no frame is left."""
        return []

    @abstractmethod
    def _best(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate, given the partial results of all shards."""

    @abstractmethod
    def _partial(self) -> Partial:
        """Return what the windows that end in the shard have of the last frame, (n,) float64."""
