"""The uncertainty of a match's pose."""

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

HIGHEST = 1e6
"""Variance of an unknown coordinate."""

_LEAST = 1e-2  # least variance, where a map's poses coincide: filters need one above 0
_ROUNDED = 1e-9  # greatest rounding error of a probability of 0 or 1


def pose_variances(
    poses: NDArray[np.float64], place: int, tolerance: int, probability: float
) -> tuple[float, float]:
    """Return the variances of a match's pose: of x as of y, square metres, and of yaw, rad².

    A match states that with this probability the vehicle is within so many places of the matched
    one. It states nothing about the rest. This is the Gaussian that states the same: it is centred
    at the place's pose, is the same in x and y, and has that probability within the reach. The
    reach is the distance to the farthest pose that the vehicle may be nearest to, and to the next
    pose, because the vehicle may be between the two. The variance of the yaw is computed in the
    same way from the differences in yaw.

    This is not a measured error: it does not shrink with a camera's resolution, and wrong matches
    are not near the place. Nor are the errors of successive frames independent: a filter that
    assumes so becomes surer than it should be.

    Args:
        poses: (K, 3) of the map, x and y in metres and yaw in radians; NaN where unknown: the next
            known poses are used instead, and without any the pose is unknown.
        place: that was matched, whose pose is known.
        tolerance: how many places away the vehicle may be.
        probability: that the vehicle is within the tolerance.
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
