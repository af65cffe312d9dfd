"""The rule ``evidence``: what all window lengths say of every place, on one scale."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.candidate import NO_CANDIDATE, NO_PLACES, Candidate
from placefield.matching.windows import Sums, WindowSums


def evidence(windows: WindowSums) -> Candidate:
    """Average the windows' z-normalised mean distances.

    For window length s, z_s(j) = (W_s(j) - mean W_s) / deviation W_s, where W_s(j) is the mean
    distance in the window that ends at place j, and mean and deviation are over all places. The
    evidence of place j is the mean of z_s(j) over s: the lower the better, in deviations below an
    average place. The sums give the same z_s as the means. A window in which all places are alike,
    as after some frames that were not seen, says nothing and is left out.

    Returns:
        The candidate of lowest evidence; ``NO_CANDIDATE`` where no window tells places apart, as
        before the first frame that was seen.
    """
    scores = np.zeros(windows.places)
    if not _mean_of_normalised(windows.columns, windows.first_column, scores):
        return NO_CANDIDATE
    place = int(np.argmin(scores))
    return Candidate(place, float(scores[place]), NO_PLACES, scores.astype(np.float32))


@kernel
def _mean_of_normalised(columns: Sums, first: int, scores: NDArray[np.float64]) -> int:
    """Add up the normalised sums over the windows that tell places apart; return how many do."""
    places = len(scores)
    before_wrap = min(columns.shape[1] - first, places)
    sums = np.empty(places)  # in the order of the map, so that they are added up in one order
    telling = 0
    for row in range(len(columns)):
        sums[:before_wrap] = columns[row, first : first + before_wrap]
        sums[before_wrap:] = columns[row, : places - before_wrap]
        mean = sum_of(sums) / places
        squares = squares_of(sums, mean)
        if squares > 0:
            telling += 1
            add_normalised(sums, mean, 1 / np.sqrt(squares / places), scores)
    for place in range(places):
        scores[place] /= max(telling, 1)
    return telling


@kernel
def squares_of(sums: Sums, mean: float) -> float:
    """Sum the squared differences of sums (K,) from a mean."""
    squares = np.empty_like(sums)
    for column in range(len(sums)):
        squares[column] = (sums[column] - mean) * (sums[column] - mean)
    return sum_of(squares)


@kernel
def add_normalised(sums: Sums, mean: float, scale: float, scores: NDArray[np.float64]) -> None:
    """Add to scores (K,) by how much sums are above a mean, times a scale."""
    for column in range(len(sums)):
        scores[column] += (sums[column] - mean) * scale
