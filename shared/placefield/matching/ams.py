"""The published rule: coarse to fine, lowest fine score (Eqs. 11 to 15).

The smoothed candidate is by the paper's windows, which begin at the query frame and at the
candidate's place. The immediate candidate is by their mirror images, which end there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, least_of
from placefield.matching.candidate import NO_CANDIDATE, NO_EVIDENCE, NO_PLACES, Candidate
from placefield.matching.matcher import Partial
from placefield.matching.window_matcher import ShardPlaces, WindowMatcher
from placefield.matching.windows import Sums, WindowSums

Hypotheses = NDArray[np.float64]
"""Of each coarse scale, (n, 3): its lowest sum, the hypothesis, and the sum at the smallest scale.

All are infinite where fewer frames are known than the scale has, or the map is shorter.
"""


class AmsMatcher(WindowMatcher):
    """Finds the best hypothesis of all coarse scales that have a window yet.

    Of the windows, the first length is the smallest scale s_min, the others are the coarse scales
    s_c, ascending. A partial result is each coarse scale's hypothesis; of scales that are cut to
    one length, there is one.
    """

    def _partial(self, windows: WindowSums, places: ShardPlaces) -> Partial:
        found = np.empty((max(len(windows.row_lengths) - 1, 1), 3))
        _find_hypotheses(
            windows.columns,
            windows.column(0),
            places.skipped,
            places.skipped + places.count,
            windows.row_lengths,
            windows.frames,
            found,
        )
        found[:, 1] += places.observed.start
        return found.ravel()

    def _best(
        self, windows: WindowSums, places: ShardPlaces, partials: Sequence[Partial]
    ) -> Candidate:
        """Return the candidate (Y_o, F(Y_o)), each scale's of the shard that it finds best.

        ``NO_CANDIDATE`` where fewer frames are known than the smallest coarse scale has, or the map
        is shorter.
        """
        place, score = _best_of(np.array(partials))
        if score == np.inf:
            return NO_CANDIDATE
        return Candidate(int(place), score * self._unit**2, NO_PLACES, NO_EVIDENCE)


@kernel
def _find_hypotheses(
    columns: Sums,
    first: int,
    start: int,
    stop: int,
    lengths: NDArray[np.int64],
    frames: int,
    found: Hypotheses,
) -> None:
    """Write the hypotheses of windows that end at places from ``start`` up to ``stop``."""
    smallest, coarse = lengths[0], len(lengths) - len(found)
    found[:] = np.inf
    for number in range(len(found)):
        row = coarse + number
        scale = lengths[row]
        if scale > min(frames, stop):
            break
        end = _lowest(columns[row], first, max(scale - 1, start), stop)
        field = end - (scale - 1)  # H: its first place
        hypothesis = _lowest(columns[0], first, field + smallest - 1, field + scale)
        found[number, 0] = _at(columns[row], first, end)
        found[number, 1] = hypothesis
        found[number, 2] = _at(columns[0], first, hypothesis)


@kernel
def _best_of(partials: NDArray[np.float64]) -> tuple[float, float]:
    """Return the hypothesis of the lowest score, and that, of partial results (S, 3 n).

    Each scale's is of the shard where its own sum is the lowest, the first of several.
    """
    place, lowest = partials[0, 1], np.inf
    for scale in range(0, partials.shape[1], 3):
        best = 0
        for shard in range(1, len(partials)):
            if partials[shard, scale] < partials[best, scale]:
                best = shard
        if partials[best, scale + 2] < lowest:
            place, lowest = partials[best, scale + 1], partials[best, scale + 2]
    return place, lowest


@kernel
def _lowest(sums: NDArray[np.float64], first: int, start: int, stop: int) -> int:
    """Return the first place of the lowest sum, from ``start`` up to ``stop``."""
    wrap = min(max(len(sums) - first, start), stop)  # from this place on, columns begin again
    ahead = sums[first + start : first + wrap]
    around = sums[first + wrap - len(sums) : first + stop - len(sums)]
    lowest = min(least_of(ahead), least_of(around))
    for i in range(len(ahead)):
        if ahead[i] == lowest:
            return start + i
    for i in range(len(around)):
        if around[i] == lowest:
            return wrap + i
    return start


@kernel
def _at(sums: NDArray[np.float64], first: int, place: int) -> float:
    """The sum of a place, from the column of the first on and around."""
    column = first + place
    value: float = sums[column if column < len(sums) else column - len(sums)]
    return value
