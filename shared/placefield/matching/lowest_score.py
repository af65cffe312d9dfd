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
    Candidate,
)
from placefield.matching.windows import Sums, WindowSums

Hypotheses = NDArray[np.float64]
"""Of each coarse scale, (n, 3): its lowest sum, the hypothesis, and the sum at the smallest scale.

All are infinite where the stream is shorter than the scale yet, or the map is.
"""


def lowest_score(windows: WindowSums) -> Candidate:
    """Return the hypothesis of the lowest fine score over all coarse scales that have a window yet.

    Args:
        windows: their first length is the smallest scale s_min, the others are the coarse scales
            s_c, ascending.

    Returns:
        The candidate (Y_o, F(Y_o)); ``NO_CANDIDATE`` while the stream is shorter than the
        smallest coarse scale, or the map is.
    """
    found = hypotheses(windows)
    return best_of(found, windows.unit)


def hypotheses(windows: WindowSums, own: int = 0) -> Hypotheses:
    """Return the hypothesis of each coarse scale, (n, 3).

    Args:
        windows: see ``lowest_score``.
        own: the first place at which a window may end that is considered.
    """
    found = np.full((max(len(windows.row_lengths) - 1, 1), 3), np.inf)
    _find_hypotheses(
        windows.columns,
        windows.first_column,
        own,
        windows.places,
        windows.row_lengths,
        windows.frames,
        found,
    )
    return found


def best_of(found: Hypotheses, unit: float) -> Candidate:
    """Return the best of the hypotheses, whose scores are in squared units."""
    _, place, score = found[np.argmin(found[:, 2])]
    if score == np.inf:
        return NO_CANDIDATE
    return Candidate(int(place), float(score) * unit**2, NO_PLACES, NO_EVIDENCE)


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
