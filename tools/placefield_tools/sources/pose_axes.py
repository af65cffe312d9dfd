"""Projection of poses in three dimensions onto the ground, by their axes."""

import logging

import numpy as np
from numpy.typing import NDArray

from placefield.maps.trajectory import PoseAxes

_AS_LONG = 0.3  # of the longest extent along a ground axis: no road is as steep
_AS_FLAT = 3.0  # times the shortest extent

log = logging.getLogger(__name__)


def ground_poses(
    name: str,
    positions: NDArray[np.float64],
    forwards: NDArray[np.float64],
    axes: PoseAxes,
    remedy: str,
) -> NDArray[np.float64]:
    """Project poses onto the ground: x and y in metres, and the yaw of the forward axis in radians.

    A vertical motion that no vehicle makes is logged: the axes are probably others.

    Args:
        name: of their origin, used in messages.
        positions: (N, 3) x, y and z, metres.
        forwards: (N, 3) direction of the forward axis, of any length.
        axes: of positions and directions.
        remedy: what to do if the axes are others, used in the message.

    Returns:
        (N, 3) float64.
    """
    if axes == "z-forward":
        positions, forwards = _as_vehicle(positions), _as_vehicle(forwards)
    _warn_of_axes(name, positions, axes, remedy)
    return np.column_stack([positions[:, :2], np.arctan2(forwards[:, 1], forwards[:, 0])])


def _as_vehicle(camera: NDArray[np.float64]) -> NDArray[np.float64]:
    right, down, forward = camera.T
    return np.column_stack([forward, -right, -down])


def forwards_of(quaternions: NDArray[np.float64], axes: PoseAxes) -> NDArray[np.float64]:
    """Return the direction of the forward axis after rotation by quaternions.

    Args:
        quaternions: (N, 4) x, y, z and w, of any length.
        axes: the axes that they rotate.

    Returns:
        (N, 3) float64, of any length.
    """
    largest = np.abs(quaternions).max(axis=1, keepdims=True)
    x, y, z, w = (quaternions / np.where(largest > 0, largest, 1)).T  # no product overflows
    if axes == "x-forward":
        return np.column_stack(
            [w * w + x * x - y * y - z * z, 2 * (w * z + x * y), 2 * (x * z - w * y)]
        )
    return np.column_stack(
        [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z]
    )


def _warn_of_axes(name: str, positions: NDArray[np.float64], axes: PoseAxes, remedy: str) -> None:
    forward, left, up = np.ptp(positions, axis=0)
    if up > _AS_LONG * max(forward, left) and up > _AS_FLAT * min(forward, left):
        log.warning(
            "%s: moves %.3g m vertically, and %.3g m by %.3g m on the ground, if its axes are %s; "
            "if they are others, %s",
            name,
            up,
            forward,
            left,
            axes,
            remedy,
        )
