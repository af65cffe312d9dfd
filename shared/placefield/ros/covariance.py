"""How sure a match is, as ROS says it: the covariance of a pose."""

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

UNKNOWN = 1e6
"""Variance of what a match says nothing of: height, roll and pitch."""

_LEAST = 1e-2  # variance; where a map's poses coincide: a filter takes none of nought
_ROUNDED = 1e-9  # what a probability of 0 or 1 is rounded from, at most


def pose_covariance(
    poses: NDArray[np.float64], place: int, tolerance: int, probability: float
) -> NDArray[np.float64]:
    """Return the covariance of a match's pose.

    A match says: with this probability the vehicle is within so many places of the one named. It
    says no more, and nothing of where it is otherwise. So this is the Gaussian that says the same:
    round the place's pose, the same in x and y, with that probability within the reach, which is
    how far the farthest pose is that the vehicle may be nearest to, and the next one, for it may be
    between them. The yaw's is made likewise from how much the yaw differs there.

    It is not an error that was measured: it does not shrink with a camera's resolution, and what is
    wrong is not near. Of successive frames it is not independent, either: a filter that takes them
    for so grows surer than it should.

    Args:
        poses: (K, 3) of the map, x and y in metres and yaw in radians.
        place: that was matched.
        tolerance: how many places away the vehicle may be.
        probability: that it is.

    Returns:
        (6, 6) of x, y, z and the rotations about them, square metres and square radians.
    """
    near = poses[max(place - tolerance - 1, 0) : place + tolerance + 2] - poses[place]
    away = np.hypot(near[:, 0], near[:, 1]).max()
    turned = np.abs(np.angle(np.exp(1j * near[:, 2]))).max()
    sure = min(max(probability, _ROUNDED), 1 - _ROUNDED)
    in_plane = away**2 / (-2 * math.log(1 - sure))  # Rayleigh: 1 - exp(-away² / 2σ²) is sure
    of_yaw = (turned / NormalDist().inv_cdf((1 + sure) / 2)) ** 2
    xy, yaw = np.clip([in_plane, of_yaw], _LEAST, UNKNOWN)
    return np.diag([xy, xy, UNKNOWN, UNKNOWN, UNKNOWN, yaw])
