"""What the inliers along a drive say of its matches: a hidden Markov model.

The match of a frame is wrong; or it is right, and the local features are found again; or it is
right, and they are missed, as in blur, or from another side of the road. If they are missed, there
are as many inliers as by chance. How many are found again, and how often and how long they are
missed, depends on light and road, and is learned along the drive: each of many such conditions has
a chain of its own, and a probability. So few inliers say nothing by night. By day, after many
frames with many inliers, they speak against a match.
"""

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from placefield.verification.likelihood import likelihood_ratios

_FRACTIONS = (4, 8, 16, 32, 64)  # one of so many local features is found again, in the mean
_MISSING = (1 / 64, 1 / 16, 1 / 4, 15 / 16)  # fraction of right matches whose features are missed
_LASTS = (1, 4, 16, 64)  # frames, in the mean, until it is drawn anew whether they are missed
_CONDITIONS = tuple(product(_FRACTIONS, _MISSING, _LASTS))
_LOSE = 0.003  # chance that a right match is followed by a wrong one: ``LOSE`` of the filter
_RIGHT_AGAIN = 0.05  # chance that a wrong match is followed by a right one
_CHANGE = 0.001  # chance that the condition changes from one frame to the next
_PRIOR_ODDS = _RIGHT_AGAIN / _LOSE  # of a right match, without any inliers
_FOUND, _WRONG = 0, 2  # 1 is missed
_SHAPE = len(_CONDITIONS), 3

STATES = len(_CONDITIONS) * 3
"""Number of hidden states: found, missed and wrong under each of the conditions."""

Array = NDArray[np.float64]
"""The posterior of a drive after a frame: (STATES,) float64, probabilities of sum 1."""


class InlierModel:
    """The model of the inliers on a map. All drives may share it."""

    def __init__(self, by_chance: NDArray[np.integer], most: int) -> None:
        """Prepare for a map.

        Args:
            by_chance: (O,) inliers of pairs of views of two of its places, O ≥ 1.
            most: local features of a place.
        """
        means = [most / fraction for fraction, _, _ in _CONDITIONS]
        self._ratios = likelihood_ratios(by_chance, means, most)
        self._transitions = np.array([_transition(*each[1:]) for each in _CONDITIONS])
        self._stationary = np.array([_stationary(missing) for _, missing, _ in _CONDITIONS])

    def predict(self, posterior: Array | None, frames: int) -> Array:
        """Return the prediction of the posterior some frames later.

        Args:
            posterior: after a frame; None before the first frame of a drive.
            frames: how many frames later, at least 1.
        """
        if posterior is None:
            return np.ravel(self._stationary / len(_CONDITIONS))
        steps = np.linalg.matrix_power(self._transitions, frames)
        same = (posterior.reshape(_SHAPE)[:, None] @ steps)[:, 0]
        wrong = same[:, _WRONG].sum()
        right = self._stationary[:, :_WRONG]
        right = right / right.sum(axis=1, keepdims=True) * (1 - wrong)
        anew = np.column_stack([right, np.full(len(right), wrong)]) / len(right)
        unchanged = math.pow(1 - _CHANGE, frames)
        return np.ravel(unchanged * same + (1 - unchanged) * anew)

    def update(self, predicted: Array, inliers: int) -> Array:
        """Return the posterior after a frame with this many inliers."""
        joint = predicted.reshape(_SHAPE).copy()
        joint[:, _FOUND] *= self._ratios[:, min(inliers, self._ratios.shape[1] - 1)]
        return np.ravel(joint / joint.sum())


def ratio_of_posterior(posterior: Array) -> float:
    """Return how much likelier the inliers so far are if the match of the frame is right."""
    wrong = float(posterior.reshape(_SHAPE)[:, _WRONG].sum())
    return (1 - wrong) / wrong / _PRIOR_ODDS


def _transition(missing: float, lasts: float) -> Array:
    """Return the chance of each state after each, (3, 3)."""
    drawn = np.array([1 - missing, missing])
    right = (1 - 1 / lasts) * np.eye(2) + drawn / lasts
    return np.block(
        [[(1 - _LOSE) * right, np.full((2, 1), _LOSE)], [_RIGHT_AGAIN * drawn, 1 - _RIGHT_AGAIN]]
    )


def _stationary(missing: float) -> Array:
    """Return the chance of each state at any frame, (3,)."""
    right = _PRIOR_ODDS / (1 + _PRIOR_ODDS)
    return np.array([right * (1 - missing), right * missing, 1 - right])
