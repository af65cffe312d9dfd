"""The pose of one camera relative to another, from the correspondences of their images.

The axes of a camera are x to the right, y down and z forward.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError
from placefield.features.calibration import View
from placefield.verification.local_features import SIDE
from placefield.verification.two_views import TOLERANCE, Correspondences, ransac_settings

_LEAST = 15  # correspondences that fit: with fewer, the pose may be one of pure chance
_STEPS = 20  # of Gauss and Newton
_LEAST_DEVIATION = 0.2  # pixels: keypoints are not found more exactly
_ANY = math.pi  # radians, the deviation of an angle that nothing is known of
_TUKEY = 4.685  # deviations: 95 % as efficient as plain least squares for Gaussian errors
_MOST_LEVERAGE = 0.999
_MEDIAN_TO_DEVIATION = 1.4826
_DIFFERENCE = 1e-6  # radians, for derivatives

Array = NDArray[np.float64]


class Camera(NamedTuple):
    """A pinhole camera whose principal point is the middle of its image.

    Attributes:
        focal: focal length, as a fraction of the image's longest side.
    """

    focal: float


def camera_of(view: View | None, focal: float | None) -> Camera | None:
    """Return the camera whose images relative poses are measured in; None if it is not known.

    Args:
        view: of the map, whose camera's calibration is known; None: it is not.
        focal: the setting ``verification.focal``; None: it is not given.

    Raises:
        ConfigError: there are both.
    """
    if view is not None and focal is not None:
        raise ConfigError(
            "setting verification.focal: the camera's calibration gives it; leave it out"
        )
    if view is not None:
        focal = view.focal
    return None if focal is None else Camera(focal)


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The pose of a second camera in the axes of the first.

    Attributes:
        rotation: (3, 3), the columns are the second camera's axes.
        direction: (3,) of length 1, from the first camera to the second.
        covariance: (5, 5), radians²: of the rotation, as a small rotation vector in the axes of the
            first camera, and of the direction, along the two columns of ``tangents_of``.
        inliers: (m,) bool, the correspondences that it explains.
    """

    rotation: Array
    direction: Array
    covariance: Array
    inliers: NDArray[np.bool_]


def relative_pose(found: Correspondences, camera: Camera, seed: int) -> RelativePose | None:
    """Return the pose of the other image's camera relative to the one image's.

    The essential matrix that most correspondences fit is found by MAGSAC++. Then the pose is that
    of the least Sampson distances (Hartley and Zisserman, section 11.4.3) by Tukey's robust loss,
    and the covariance is the inverse of its information. An angle that the images do not determine,
    as the direction between two cameras at one point, has a deviation of half a turn.

    Args:
        found: correspondences of the two images, which one camera took.
        camera: the camera.
        seed: the same seed gives the same result.

    Returns:
        The pose; None if fewer than 15 correspondences fit one.
    """
    if len(found.one) < _LEAST:
        return None
    one, other = found.one / camera.focal, found.other / camera.focal
    settings = ransac_settings(seed, TOLERANCE / (SIDE * camera.focal))
    unit = np.eye(3)
    try:
        essential, mask = cv2.findEssentialMat(one, other, unit, unit, None, None, settings)
    except cv2.error:  # it found no model at all
        return None
    if essential is None or mask is None or essential.shape != (3, 3):
        return None
    inliers = mask.ravel().astype(np.bool_)
    if inliers.sum() < _LEAST:
        return None
    _, back, towards, _ = cv2.recoverPose(essential, one[inliers], other[inliers], unit)
    rotation = np.asarray(back.T, np.float64)  # OpenCV's maps the first camera's axes to the second
    direction = -rotation @ np.asarray(towards, np.float64).ravel()
    rays = rays_of(found.one, camera), rays_of(found.other, camera)
    rotation, direction, covariance, inliers = _refined(
        rotation, direction, *rays, settings.threshold
    )
    if inliers.sum() < _LEAST:
        return None
    return RelativePose(rotation, direction, covariance, inliers)


def rays_of(points: Array, camera: Camera) -> Array:
    """Return the rays of a camera's points (m, 2), see ``LocalFeatures``: (m, 3), z is 1."""
    return np.column_stack([points / camera.focal, np.ones(len(points))])


def tangents_of(direction: Array) -> Array:
    """Return two orthonormal vectors that are orthogonal to a direction, as columns (3, 2)."""
    least = np.eye(3)[np.abs(direction).argmin()]
    first = np.cross(direction, least)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(direction, first)])


def moved(rotation: Array, direction: Array, tangents: Array, by: Array) -> tuple[Array, Array]:
    """Return a rotation and a direction after a change (5,), see ``RelativePose.covariance``.

    ``tangents`` are those of the direction.
    """
    turned = cv2.Rodrigues(by[:3])[0] @ rotation
    aside = direction + tangents @ by[3:]
    return turned, aside / np.linalg.norm(aside)


def _refined(
    rotation: Array, direction: Array, one: Array, other: Array, tolerance: float
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Fit a pose to the rays (m, 3) by iteratively reweighted least squares, with Tukey's weights.

    All correspondences take part, because the first pose may leave out right ones for a wrong one
    that lies near its epipolar line by chance. Distances are studentised: a correspondence that the
    pose depends on much lies near its line even if it is wrong.

    Returns:
        The rotation, the direction, their covariance, and which correspondences have a weight.
    """
    least = _LEAST_DEVIATION / TOLERANCE * tolerance
    leverage = np.zeros(len(one))
    for _ in range(_STEPS):
        distances = _sampson(rotation, direction, one, other)
        front = _in_front(rotation, direction, one, other, tolerance)
        tangents, columns = tangents_of(direction), []
        for step in _DIFFERENCE * np.eye(5):
            ahead = _sampson(*moved(rotation, direction, tangents, step), one, other)
            behind = _sampson(*moved(rotation, direction, tangents, -step), one, other)
            columns.append((ahead - behind) / (2 * _DIFFERENCE))
        jacobian = np.column_stack(columns)
        near = np.abs(distances)[front & (np.abs(distances) < tolerance)]
        deviation = (
            max(_MEDIAN_TO_DEVIATION * float(np.median(near)), least) if len(near) else least
        )
        student = distances / (deviation * np.sqrt(1 - leverage))
        weights = front * np.maximum(1 - (student / _TUKEY) ** 2, 0) ** 2
        information = (jacobian.T * weights) @ jacobian / deviation**2 + np.eye(5) / _ANY**2
        covariance = np.linalg.inv(information)
        leverage = ((jacobian @ covariance) * jacobian).sum(axis=1) / deviation**2
        leverage = np.minimum(weights * leverage, _MOST_LEVERAGE)
        by = -covariance @ (jacobian.T @ (weights * distances)) / deviation**2
        rotation, direction = moved(rotation, direction, tangents, by)
    return rotation, direction, covariance, weights > 0


def _sampson(rotation: Array, direction: Array, one: Array, other: Array) -> Array:
    """Return the signed Sampson distances of rays (m, 3) from their epipolar lines, (m,)."""
    x, y, z = direction
    essential = rotation.T @ np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    lines, back = one @ essential.T, other @ essential
    squares = (lines[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)
    return np.asarray((other * lines).sum(axis=1) / np.sqrt(np.maximum(squares, 1e-18)))


def _in_front(
    rotation: Array, direction: Array, one: Array, other: Array, tolerance: float
) -> NDArray[np.bool_]:
    """Return which rays (m, 3) meet in front of both cameras, or are nearly parallel, (m,)."""
    turned = other @ rotation.T
    first, second = depths(direction, one, turned)
    across = np.linalg.norm(np.cross(one, turned), axis=1)
    nearly = across < 2 * tolerance * np.linalg.norm(one, axis=1) * np.linalg.norm(turned, axis=1)
    return np.asarray(nearly | ((first > 0) & (second > 0)))


def depths(direction: Array, one: Array, turned: Array) -> tuple[Array, Array]:
    """Return how far along the rays of two cameras their points are, each (m,), in baselines.

    A point is where its rays are nearest to each other. All are in the axes of the first camera.

    Args:
        direction: (3,) of length 1, from the first camera to the second.
        one: (m, 3), rays of the first camera.
        turned: (m, 3), rays of the second camera.
    """
    oneone, both, two = (
        (a * b).sum(axis=1) for a, b in ((one, one), (one, turned), (turned, turned))
    )
    on_one, on_two = one @ direction, turned @ direction
    determinant = np.maximum(oneone * two - both**2, 1e-18)
    return (two * on_one - both * on_two) / determinant, (
        both * on_one - oneone * on_two
    ) / determinant
