"""How sure a match is of where the vehicle is."""

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

HIGHEST = 1e6
"""Variance of what is not known at all."""

_LEAST = 1e-2  # variance; where a map's poses coincide: a filter takes none of nought
_ROUNDED = 1e-9  # what a probability of 0 or 1 is rounded from, at most


def pose_variances(
    poses: NDArray[np.float64], place: int, tolerance: int, probability: float
) -> tuple[float, float]:
    """Return the variances of a match's pose: of x as of y, square metres, and of yaw, rad².

    A match says: with this probability the vehicle is within so many places of the one named. It
    says no more, and nothing of where it is otherwise. So this is the Gaussian that says the same:
    round the place's pose, the same in x and y, with that probability within the reach, which is
    how far the farthest pose is that the vehicle may be nearest to, and the next one, for it may be
    between them. The yaw's is made likewise from how much the yaw differs there.

    It is not an error that was measured: it does not shrink with a camera's resolution, and what is
    wrong is not near. Of successive frames it is not independent, either: a filter that takes them
    for so grows surer than it should.

    Args:
        poses: (K, 3) of the map, x and y in metres and yaw in radians; NaN where nobody knows, so
            that the next ones that are known are looked at; where there is none, all is unknown.
        place: that was matched, whose pose is known.
        tolerance: how many places away the vehicle may be.
        probability: that it is.
    """
    first = max(place - tolerance - 1, 0)
    last = min(place + tolerance + 1, len(poses) - 1)
    while first >= 0 and not np.isfinite(poses[first]).all():
        first -= 1
    while last < len(poses) and not np.isfinite(poses[last]).all():
        last += 1
    if first < 0 or last == len(poses):
        return HIGHEST, HIGHEST
    near = poses[first : last + 1] - poses[place]
    near = near[np.isfinite(near).all(axis=1)]
    away = np.hypot(near[:, 0], near[:, 1]).max()
    turned = np.abs(np.angle(np.exp(1j * near[:, 2]))).max()
    sure = min(max(probability, _ROUNDED), 1 - _ROUNDED)
    in_plane = away**2 / (-2 * math.log(1 - sure))  # Rayleigh: 1 - exp(-away² / 2σ²) is sure
    of_yaw = (turned / NormalDist().inv_cdf((1 + sure) / 2)) ** 2
    xy, yaw = np.clip([in_plane, of_yaw], _LEAST, HIGHEST)
    return float(xy), float(yaw)
