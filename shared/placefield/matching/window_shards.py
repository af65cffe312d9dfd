"""The rules that compare windows, in a shard.

A window that ends in a shard may begin before it. So each is shown as many places before its own as
the longest window reaches back, and has the same sums as the whole map, to the last bit.
"""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from placefield.kernels import sum_of
from placefield.maps.map import MapMetric
from placefield.matching.candidate import NO_CANDIDATE, NO_PLACES, Candidate
from placefield.matching.comparing import Comparison
from placefield.matching.evidence import add_normalised, squares_of
from placefield.matching.lowest_score import best_of, hypotheses
from placefield.matching.shard_matcher import ShardMatcher, Summary
from placefield.matching.windows import Sums, WindowSums
from placefield.metric.codes import Codes


class MeanDistance:
    """The mean squared distance of frames to all places of a map, which windows fall back on."""

    def __init__(self, metric: MapMetric) -> None:
        """Take the whole map's metric."""
        self._places = len(metric.places)
        self._codes = metric.places.sum(axis=0, dtype=np.int64)
        self._squares = int(metric.squares.sum(dtype=np.int64))

    def __call__(self, codes: Codes) -> int:
        """Return that of a frame's codes (M,), the whole number that is nearest."""
        wide = codes.astype(np.int64)
        total = self._places * int(wide @ wide) + self._squares - 2 * int(wide @ self._codes)
        return round(total / self._places)


class _WindowShard(ShardMatcher):
    """Compares windows that end in a shard."""

    def __init__(
        self, windows: WindowSums, mean_distance: MeanDistance, seen: slice, own: slice
    ) -> None:
        """Take new windows.

        Args:
            windows: over the places that are seen.
            mean_distance: to all places.
            seen: the shard's places, and those that windows reach back to, in the map.
            own: the shard's.
        """
        self._windows = windows
        self._mean_distance = mean_distance
        self._first_seen = seen.start
        self._reached_back = own.start - seen.start
        self.memory = int(windows.row_lengths.max())

    def push(self, frame: Comparison | None) -> Summary:
        """Move the windows on; frames not seen keep the others aligned."""
        if frame is None:
            self._windows.push_unseen()
        else:
            self._windows.push(frame.distances, self._mean_distance(frame.codes))
        return self._summary()

    @abstractmethod
    def _summary(self) -> Summary:
        """Return what the shard has of the frame that was pushed last."""


class EvidenceShard(_WindowShard):
    """The rule ``evidence``.

    A summary is how many places there are, the sum of each window's sums over them, and the sum of
    their squared differences from the mean.
    """

    def _summary(self) -> Summary:
        self._sums = np.ascontiguousarray(self._windows.sums[:, self._reached_back :])
        totals = [sum_of(row) for row in self._sums]
        places = self._sums.shape[1]
        squares = [
            squares_of(row, total / places) for row, total in zip(self._sums, totals, strict=True)
        ]
        return np.array([places, *totals, *squares], np.float64)

    def finish(self, summaries: Sequence[Summary]) -> Candidate:
        """Average the windows' sums, normalised over all places."""
        means, deviations = _moments(np.stack(summaries))
        scores = np.zeros(self._sums.shape[1])
        telling = np.flatnonzero(deviations)
        if not len(telling):
            return NO_CANDIDATE
        for row in telling:
            add_normalised(self._sums[row], means[row], 1 / deviations[row], scores)
        scores /= len(telling)
        place = int(np.argmin(scores))
        own = self._first_seen + self._reached_back
        return Candidate(own + place, float(scores[place]), NO_PLACES, scores.astype(np.float32))


def _moments(summaries: Sums) -> tuple[Sums, Sums]:
    """Return mean and standard deviation of each window's sums over all shards' places."""
    places = summaries[:, :1]
    totals, squares = np.split(summaries[:, 1:], 2, axis=1)
    means = totals.sum(axis=0) / places.sum()
    apart = places * (totals / places - means) ** 2
    return means, np.sqrt((squares + apart).sum(axis=0) / places.sum())


class LowestScoreShard(_WindowShard):
    """The rule ``lowest-score``; a summary is each coarse scale's hypothesis."""

    def _summary(self) -> Summary:
        found = hypotheses(self._windows, self._reached_back)
        found[:, 1] += self._first_seen
        return found.ravel()

    def finish(self, summaries: Sequence[Summary]) -> Candidate:
        """Return the best of the hypotheses, each of the shard that its scale finds best."""
        found = np.stack(summaries).reshape(len(summaries), -1, 3)
        best = found[:, :, 0].argmin(axis=0)
        return best_of(found[best, np.arange(len(best))], self._windows.unit)
