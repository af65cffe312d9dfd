"""The uncertainty of a match as ROS expects it: the covariance of a pose."""

import numpy as np
from numpy.typing import NDArray

from placefield.fusion.uncertainty import HIGHEST, pose_variances


def pose_covariance(
    poses: NDArray[np.float64], place: int, tolerance: int, probability: float
) -> NDArray[np.float64]:
    """Return the covariance of a match's pose, see ``pose_variances``.

    Returns:
        (6, 6) of x, y, z and the rotations about them, square metres and square radians. A match
        has no height, roll or pitch, so their variance is ``HIGHEST``.
    """
    xy, yaw = pose_variances(poses, place, tolerance, probability)
    return np.diag([xy, xy, HIGHEST, HIGHEST, HIGHEST, yaw])
