"""The rule ``evidence``: what all window lengths say of every place, on one scale."""

import numpy as np

from placefield.matching.candidate import NO_CANDIDATE, Candidate
from placefield.matching.windows import WindowSums


def evidence(windows: WindowSums) -> Candidate:
    """Average the windows' z-normalised mean distances.

    For window length s, z_s(j) = (W_s(j) - mean W_s) / deviation W_s, where W_s(j) is the mean
    distance in the window that ends at place j, and mean and deviation are over all places. The
    evidence of place j is the mean of z_s(j) over s: the lower the better, in deviations below an
    average place.

    Returns:
        The candidate of lowest evidence; ``NO_CANDIDATE`` where all places are alike, as before
        the first frame that could be seen.
    """
    means = windows.sums / windows.spans[:, None]
    deviations = means.std(axis=1, keepdims=True)
    if not np.all(deviations > 0):
        return NO_CANDIDATE
    scores = ((means - means.mean(axis=1, keepdims=True)) / deviations).mean(axis=0)
    scores = scores.astype(np.float32)
    place = int(np.argmin(scores))
    return Candidate(place, float(scores[place]), scores)
