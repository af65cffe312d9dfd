"""The published rule, to the letter: coarse to fine, lowest fine score (Eqs. 11 to 15).

Causal: windows end at the newest query frame and at the place that is its answer, where the
paper's begin there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.candidate import NO_CANDIDATE, NO_EVIDENCE, NO_PLACES, Candidate
from placefield.matching.matcher import Partial
from placefield.matching.window_matcher import WindowMatcher
from placefield.matching.windows import Sums

Hypotheses = NDArray[np.float64]
"""Of each coarse scale, (n, 3): its lowest sum, the hypothesis, and the sum at the smallest scale.

All are infinite where the stream is shorter than the scale yet, or the map is.
"""


class LowestScoreMatcher(WindowMatcher):
    """Finds the best hypothesis of all coarse scales that have a window yet.

    Of the windows, the first length is the smallest scale s_min, the others are the coarse scales
    s_c, ascending. A partial result is each coarse scale's hypothesis.
    """

    def _partial(self) -> Partial:
        windows = self._windows
        found = np.full((max(len(windows.row_lengths) - 1, 1), 3), np.inf)
        _find_hypotheses(
            windows.columns,
            windows.column(0),
            self._reached_back,
            windows.places,
            windows.row_lengths,
            windows.frames,
            found,
        )
        found[:, 1] += self._first_observed
        return found.ravel()

    def _best(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate (Y_o, F(Y_o)), each scale's of the shard that it finds best.

        ``NO_CANDIDATE`` while the stream is shorter than the smallest coarse scale, or the map is.
        """
        place, score = _best_of(np.array(partials))
        if score == np.inf:
            return NO_CANDIDATE
        unit = self._windows.unit
        return Candidate(int(place), score * unit**2, NO_PLACES, NO_EVIDENCE)


@kernel
def _find_hypotheses(
    columns: Sums,
    first: int,
    own: int,
    places: int,
    lengths: NDArray[np.int64],
    frames: int,
    found: Hypotheses,
) -> None:
    smallest, coarse = lengths[0], len(lengths) - len(found)
    for number in range(len(found)):
        row = coarse + number
        scale = lengths[row]
        if scale > min(frames, places):
            break
        end = _lowest(columns[row], first, max(scale - 1, own), places)
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
    place, lowest = start, np.inf
    for j in range(start, stop):
        value = _at(sums, first, j)
        if value < lowest:
            place, lowest = j, value
    return place


@kernel
def _at(sums: NDArray[np.float64], first: int, place: int) -> float:
    """The sum of a place, from the column of the first on and around."""
    column = first + place
    value: float = sums[column if column < len(sums) else column - len(sums)]
    return value
