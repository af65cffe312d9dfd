"""The published rule, to the letter: coarse to fine, lowest fine score (Eqs. 11 to 15).

Causal: windows end at the newest query frame and at the place that is its answer, where the
paper's begin there.
"""

import numpy as np

from placefield.matching.candidate import NO_CANDIDATE, NO_EVIDENCE, Candidate
from placefield.matching.windows import WindowSums


def lowest_score(windows: WindowSums) -> Candidate:
    """Return the hypothesis of the lowest fine score over all coarse scales that have a window yet.

    Args:
        windows: their first length is the smallest scale s_min, the others are the coarse scales
            s_c, ascending.

    Returns:
        The candidate (Y_o, F(Y_o)); ``NO_CANDIDATE`` while the stream is shorter than the
        smallest coarse scale, or the map is.
    """
    smallest, fine_sums = windows.lengths[0], windows.sums[0]
    coarse = range(1, len(windows.lengths)) or (0,)  # a channel of one scale has no other
    best = NO_CANDIDATE
    for row in coarse:
        scale = windows.lengths[row]
        if scale > min(windows.frames, len(fine_sums)):
            break
        field = int(np.argmin(windows.sums[row, scale - 1 :]))  # H: first place of the field
        within = slice(field + smallest - 1, field + scale)
        hypothesis = within.start + int(np.argmin(fine_sums[within]))
        if best is NO_CANDIDATE or fine_sums[hypothesis] < best.score:
            best = Candidate(hypothesis, float(fine_sums[hypothesis]), NO_EVIDENCE)
    return best
