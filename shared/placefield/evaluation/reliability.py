"""Compares the probabilities of matches with how often the matches are right."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Matches, binned by their probability of being right.

    Bin b of B holds the matches of a probability of at least b / B and below (b + 1) / B; the last
    one also holds those of probability 1.

    Attributes:
        count: matches in each bin, (B,) int64.
        mean_probability: of each bin's matches, (B,) float64; NaN in an empty bin.
        share_correct: fraction of each bin's matches that are right, (B,) float64; NaN in an empty
            bin.
        expected_calibration_error: mean over all matches of their bin's |share_correct -
            mean_probability| (Naeini et al. 2015, Guo et al. 2017); 0 if there are no matches.
    """

    count: NDArray[np.int64]
    mean_probability: NDArray[np.float64]
    share_correct: NDArray[np.float64]
    expected_calibration_error: float


def reliability(
    probability: NDArray[np.float64], correct: NDArray[np.bool_], bins: int = 10
) -> Reliability:
    """Compare the probabilities of matches with how often these are right, bin by bin.

    Args:
        probability: that the match is right, (Q,) float64.
        correct: whether the match is right, (Q,) bool.
        bins: number of bins of equal width over [0, 1], 1 or more.

    Raises:
        ValueError: the shapes differ, a probability lies outside [0, 1], or there is no bin.
    """
    if not probability.shape == correct.shape == (len(probability),):
        raise ValueError("probability and correct must have one and the same length")
    if not np.all((probability >= 0) & (probability <= 1)):
        raise ValueError("a probability lies outside [0, 1]")
    if bins < 1:
        raise ValueError(f"{bins} bins: give 1 or more")

    bin_of = np.searchsorted(np.arange(1, bins) / bins, probability, side="right")
    count = np.bincount(bin_of, minlength=bins)
    total_probability = np.bincount(bin_of, weights=probability, minlength=bins)
    total_correct = np.bincount(bin_of, weights=correct, minlength=bins)
    empty_as_nan = np.where(count > 0, count, np.nan)
    difference = np.abs(total_correct - total_probability)  # of each bin, times its count
    return Reliability(
        count=count,
        mean_probability=total_probability / empty_as_nan,
        share_correct=total_correct / empty_as_nan,
        expected_calibration_error=float(difference.sum() / max(len(probability), 1)),
    )
