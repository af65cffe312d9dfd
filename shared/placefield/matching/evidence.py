"""The rule ``evidence``: what all window lengths say of every place, on one scale."""

import numpy as np

from placefield.matching.candidate import NO_CANDIDATE, Candidate
from placefield.matching.windows import WindowSums


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
    deviations = windows.sums.std(axis=1)
    telling = deviations > 0
    if not telling.any():
        return NO_CANDIDATE
    sums = windows.sums[telling]
    normalised = (sums - sums.mean(axis=1, keepdims=True)) / deviations[telling, None]
    scores = normalised.mean(axis=0).astype(np.float32)
    place = int(np.argmin(scores))
    return Candidate(place, float(scores[place]), scores)
