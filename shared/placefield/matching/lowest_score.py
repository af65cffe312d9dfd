"""The published rule, to the letter: coarse to fine, lowest fine score (Eqs. 11 to 15).

Causal: windows end at the newest query frame and at the place that is its answer, where the
paper's begin there.
"""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.candidate import (
    NO_CANDIDATE,
    NO_EVIDENCE,
    NO_PLACES,
    UNANSWERED,
    Candidate,
)
from placefield.matching.windows import Sums, WindowSums


def lowest_score(windows: WindowSums) -> Candidate:
    """Return the hypothesis of the lowest fine score over all coarse scales that have a window yet.

    Args:
        windows: their first length is the smallest scale s_min, the others are the coarse scales
            s_c, ascending.

    Returns:
        The candidate (Y_o, F(Y_o)); ``NO_CANDIDATE`` while the stream is shorter than the
        smallest coarse scale, or the map is.
    """
    place, score = _hypothesis(
        windows.columns, windows.first_column, windows.places, windows.row_lengths, windows.frames
    )
    if place == UNANSWERED:
        return NO_CANDIDATE
    return Candidate(place, score * windows.unit**2, NO_PLACES, NO_EVIDENCE)


@kernel
def _hypothesis(
    columns: Sums, first: int, places: int, lengths: NDArray[np.int64], frames: int
) -> tuple[int, float]:
    """Find the best hypothesis and its fine score, in the units of the sums."""
    best, best_score = UNANSWERED, np.inf
    smallest = lengths[0]
    for row in range(min(1, len(lengths) - 1), len(lengths)):  # one scale alone is coarse, too
        scale = lengths[row]
        if scale > min(frames, places):
            break
        field = _lowest(columns[row], first, scale - 1, places) - (scale - 1)  # H: its first place
        hypothesis = _lowest(columns[0], first, field + smallest - 1, field + scale)
        score = columns[0, (first + hypothesis) % columns.shape[1]]
        if score < best_score:
            best, best_score = hypothesis, score
    return best, best_score


@kernel
def _lowest(sums: NDArray[np.float64], first: int, start: int, stop: int) -> int:
    """Return the first place of the lowest sum, from ``start`` up to ``stop``."""
    place, lowest = start, np.inf
    for j in range(start, stop):
        column = first + j
        value = sums[column if column < len(sums) else column - len(sums)]
        if value < lowest:
            place, lowest = j, value
    return place
