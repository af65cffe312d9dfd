"""Rectification: the image of a calibrated camera, rendered into the view of a pinhole camera."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.calibration import WIDEST, Calibration, View
from placefield.features.frames import Frame
from placefield.features.images import MIN_SIDE, check_pixels

LEAST_SEEN = 0.75
"""The least fraction of a map's view that a camera must see."""

_GRID = 33  # rays along each side of a view that is tried
_THIN = 0.02  # height of a view, as a fraction of its width, that tries the width alone
_HALVINGS = 40
_STEP = 1e-6  # focal lengths, for derivatives
_LEAST = 0.01  # half the width of the smallest view

Pixels = NDArray[np.uint8]
Array = NDArray[np.float64]


def view_of(calibration: Calibration) -> View:
    """Return the view that a camera fills, without black borders.

    It is as wide as the camera sees in the middle row, and as high as in the middle column, or as
    much smaller as the corners need; at most 120°.

    Raises:
        ConfigError: there is none: the principal point is outside of the image, or the distortion
            is that of no camera.
    """
    width = _most(lambda half: _fills(calibration, half, _THIN * half), WIDEST)
    height = _most(lambda half: _fills(calibration, _THIN * half, half), WIDEST)
    share = _most(lambda share: _fills(calibration, share * width, share * height), 1.0)
    if min(width, height) * share < _LEAST:
        raise ConfigError(
            "the camera has no image around its principal point; check its matrix and distortion"
        )
    return View(half_width=width * share, half_height=height * share)


def rectify(pixels: Pixels, calibration: Calibration, view: View) -> Pixels:
    """Return the image of a camera as a pinhole camera with a view would have taken it.

    What the camera does not see is as the border of its image. The scale is about the image's own.

    Args:
        pixels: (H, W) or (H, W, 3).
        calibration: of the camera; it is scaled to the size of the image.
        view: of the result.

    Returns:
        The image, (H', W') or (H', W', 3), whose longest side is at most that of ``pixels``.

    Raises:
        FrameError: the image has another aspect ratio than the calibration, or is no image.
    """
    check_pixels(pixels)
    nearest, fractions = _sources(calibration, view, *pixels.shape[:2])
    rectified = cv2.remap(
        pixels, nearest, fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(rectified, np.uint8)


def image_of(frame: Frame, view: View | None, least_side: int | None = None) -> Pixels:
    """Return the image of a frame, decoded, and rectified if there is a view.

    Args:
        frame: with an image.
        view: of the result; None: the image is not rectified.
        least_side: pixels that the result's shorter side has at least if the image is decoded to a
            part of its size, see ``images.decode``; None: the image is decoded whole.

    Raises:
        FrameError: the frame cannot be read, is a descriptor, or its camera does not fit the view
            (see ``check_calibrated``) or the image.
    """
    calibration = frame.calibration
    if view is not None and calibration is not None and least_side is not None:
        least_side = _least_before(calibration, view, least_side)
    pixels = frame.pixels(least_side)
    check_calibrated(calibration, view)
    if view is None or calibration is None:
        return pixels
    return rectify(pixels, calibration, view)


def _least_before(calibration: Calibration, view: View, least_side: int) -> int:
    """Return the least side of a camera's image, so that of its rectified image is as given."""
    shorter = min(calibration.width, calibration.height)
    rectified = 2 * min(view.half_width, view.half_height) * _focal(calibration, view)
    return math.ceil(least_side * shorter / max(rectified, MIN_SIDE))


def check_calibrated(calibration: Calibration | None, view: View | None) -> None:
    """Refuse frames of a camera that does not fit a map's view.

    Raises:
        FrameError: there is a view and the camera is not known, or the reverse; or the camera sees
            less than ``LEAST_SEEN`` of the view.
    """
    if calibration is None and view is not None:
        raise FrameError(
            "the camera is not known, and the map is of a camera's view: give the camera's "
            "calibration, as by --camera"
        )
    if calibration is not None and view is None:
        raise FrameError(
            "the camera is known, and the map is of no camera's view: leave the camera's "
            "calibration out, or build the map with --camera"
        )
    if calibration is None or view is None or (share := seen(calibration, view)) >= LEAST_SEEN:
        return
    raise FrameError(
        f"the camera sees only {share:.0%} of the map's view, and {LEAST_SEEN:.0%} are needed: "
        "build the map with --query-camera"
    )


@lru_cache(maxsize=16)
def seen(calibration: Calibration, view: View) -> float:
    """Return the fraction of a view that a camera sees, 0 to 1."""
    return float(_inside(calibration, view.half_width, view.half_height).mean())


def _most(fits: Callable[[float], bool], limit: float) -> float:
    """Return the largest number up to a limit that fits, by bisection; 0 if none does."""
    if fits(limit):
        return limit
    low, high = 0.0, limit
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _fills(calibration: Calibration, half_width: float, half_height: float) -> bool:
    return bool(_inside(calibration, half_width, half_height).all())


def _inside(calibration: Calibration, half_width: float, half_height: float) -> NDArray[np.bool_]:
    """Return which rays of a view, on a grid, are in the image, without those that fold back.

    Beyond the angles that a camera was calibrated for, its distortion may lead back into the image,
    and mirrors it.
    """
    x, y = np.meshgrid(
        np.linspace(-half_width, half_width, _GRID), np.linspace(-half_height, half_height, _GRID)
    )
    points = _project(x, y, calibration)
    right = _project(x + _STEP, y, calibration) - points
    down = _project(x, y + _STEP, calibration) - points
    is_mirrored = right[..., 0] * down[..., 1] <= right[..., 1] * down[..., 0]
    size = np.array([calibration.width, calibration.height])
    return np.asarray(~is_mirrored & ((points >= -0.5) & (points <= size - 0.5)).all(axis=-1))


def _project(x: Array, y: Array, calibration: Calibration) -> Array:
    """Return the pixels (H, W, 2) of the rays (x, y, 1), whose x and y are (H, W) each."""
    matrix, distortion = _matrix(calibration.focal, calibration.centre), _distortion(calibration)
    none = np.zeros(3)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 1, 3)
    if calibration.model == "fisheye":
        points, _ = cv2.fisheye.projectPoints(rays, none, none, matrix, distortion)
    else:
        points, _ = cv2.projectPoints(rays, none, none, matrix, distortion)
    return np.asarray(points, np.float64).reshape(*x.shape, 2)


@lru_cache(maxsize=16)
def _sources(
    calibration: Calibration, view: View, height: int, width: int
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return which pixels of an image those of a view come from, as ``cv2.remap`` takes them."""
    scaled = calibration.of_size(height, width)
    halves = np.array([view.half_width, view.half_height])
    size = np.maximum(np.rint(2 * halves * _focal(scaled, view)), MIN_SIDE)
    new = _matrix(size / (2 * halves), (size - 1) / 2)
    old, distortion = _matrix(scaled.focal, scaled.centre), _distortion(scaled)
    made = (old, distortion, np.eye(3), new, tuple(size.astype(int).tolist()), cv2.CV_16SC2)
    if calibration.model == "fisheye":
        return cv2.fisheye.initUndistortRectifyMap(*made)
    return cv2.initUndistortRectifyMap(*made)


def _focal(calibration: Calibration, view: View) -> float:
    """Return the focal length of the rectified image of a camera, pixels."""
    longest = max(calibration.height, calibration.width)
    # No image is larger than before, whatever an untrusted client says of its camera.
    largest = longest / (2 * max(view.half_width, view.half_height))
    return min(float(np.mean(calibration.focal)), largest)


def _matrix(focal: Any, centre: Any) -> Array:
    (fx, fy), (cx, cy) = focal, centre
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float64)


def _distortion(calibration: Calibration) -> Array:
    return np.array(calibration.distortion or (0.0,) * 4)
