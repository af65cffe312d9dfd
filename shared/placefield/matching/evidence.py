"""The rule ``evidence``: the evidence of all window lengths for every place, on one scale.

For window length s, z_s(j) = (W_s(j) - mean W_s) / deviation W_s, where W_s(j) is the mean distance
in the window of place j, and mean and deviation are over all places. The evidence of place j is the
mean of z_s(j) over s: the lower the better, in deviations below an average place. Sums instead of
mean distances give the same z_s. A window length whose sums are the same at all places, as after
some missing observations, is not informative and is left out.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.candidate import NO_CANDIDATE, NO_PLACES, UNANSWERED, Candidate
from placefield.matching.matcher import Partial
from placefield.matching.window_matcher import ShardPlaces, WindowMatcher
from placefield.matching.windows import Sums, WindowSums

_UNANSWERED = UNANSWERED  # a constant of compiled code


class EvidenceMatcher(WindowMatcher):
    """Averages the windows' sums, normalised over all places.

    A partial result is the number of the shard's places, the sum of each length's sums over them,
    and the sum of their squared differences from their mean.
    """

    def _partial(self, windows: WindowSums, places: ShardPlaces) -> Partial:
        lengths = len(windows.row_lengths)
        partial = np.empty(1 + 2 * lengths)
        partial[0] = places.count
        totals, squares = partial[1 : 1 + lengths], partial[1 + lengths :]
        first = windows.column(places.skipped)
        _sum_up(windows.columns, first, places.count, totals, squares)
        return partial

    def _best(
        self, windows: WindowSums, places: ShardPlaces, partials: Sequence[Partial]
    ) -> Candidate:
        """Return the candidate of lowest evidence.

        ``NO_CANDIDATE`` if no window length is informative, as before the first observation.
        """
        moments = _moments(np.array(partials))
        evidence = np.empty(places.count, np.float32)
        first = windows.column(places.skipped)
        place, score = _weigh(windows.columns, windows.row_of, first, moments, evidence)
        if place == UNANSWERED:
            return NO_CANDIDATE
        return Candidate(places.own.start + place, score, NO_PLACES, evidence)


@kernel
def _moments(partials: Sums) -> tuple[Sums, Sums]:
    """Return mean and standard deviation of each window's sums over all shards' places.

    Partial results (S, 1 + 2 n) are added up in the order of the shards.
    """
    lengths = (partials.shape[1] - 1) // 2
    means, deviations = np.zeros(lengths), np.zeros(lengths)
    every = 0.0
    for shard in range(len(partials)):
        every += partials[shard, 0]
        for row in range(lengths):
            means[row] += partials[shard, 1 + row]
    for row in range(lengths):
        means[row] /= every
        for shard in range(len(partials)):
            places, total = partials[shard, 0], partials[shard, 1 + row]
            apart = total / places - means[row]
            deviations[row] += partials[shard, 1 + lengths + row] + places * (apart * apart)
        deviations[row] = np.sqrt(deviations[row] / every)
    return means, deviations


@kernel
def _sum_up(columns: Sums, first: int, places: int, totals: Sums, squares: Sums) -> None:
    """Write the sum of each window's sums, and of their squared differences from their mean."""
    sums = np.empty(places)
    for row in range(len(columns)):
        _gather(columns[row], first, sums)
        totals[row] = sum_of(sums)
        mean = totals[row] / places
        for place in range(places):
            sums[place] = (sums[place] - mean) * (sums[place] - mean)
        squares[row] = sum_of(sums)


@kernel
def _weigh(
    columns: Sums,
    row_of: NDArray[np.int64],
    first: int,
    moments: tuple[Sums, Sums],
    evidence: NDArray[np.float32],
) -> tuple[int, float]:
    """Average the normalised sums over the informative windows.

    Args:
        columns: see ``WindowSums``.
        row_of: see ``WindowSums``.
        first: column of the first place.
        moments: see ``_moments``.
        evidence: (K,) float32, receives the averages.

    Returns:
        The first place of the lowest average, and that; ``UNANSWERED`` without such windows.
    """
    places, width = len(evidence), columns.shape[1]
    scores, (means, deviations) = np.zeros(places), moments
    before_wrap = min(width - first, places)
    informative = 0
    for row in row_of:
        if deviations[row] > 0:
            informative += 1
            scale = 1 / deviations[row]
            forward = columns[row, first : first + before_wrap]
            around = columns[row, : places - before_wrap]
            _add_normalised(forward, means[row], scale, scores[:before_wrap])
            _add_normalised(around, means[row], scale, scores[before_wrap:])
    if not informative:
        return _UNANSWERED, 0.0
    best = 0
    for place in range(places):
        scores[place] /= informative
        evidence[place] = scores[place]
        if scores[place] < scores[best]:
            best = place
    return best, scores[best]


@kernel
def _add_normalised(sums: Sums, mean: float, scale: float, scores: NDArray[np.float64]) -> None:
    """Add to scores (n,) by how much sums are above a mean, times a scale."""
    for place in range(len(sums)):
        scores[place] += (sums[place] - mean) * scale


@kernel
def _gather(columns: Sums, first: int, sums: Sums) -> None:
    """Copy sums in the order of the map, from a column on and around: sums need one order."""
    before_wrap = min(len(columns) - first, len(sums))
    for i in range(before_wrap):
        sums[i] = columns[first + i]
    for i in range(before_wrap, len(sums)):
        sums[i] = columns[i - before_wrap]
