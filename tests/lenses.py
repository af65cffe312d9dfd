"""Cameras with distortion, by the formulas of their models, and the images that they take."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.features.calibration import Calibration

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Lens:
    """A camera with radial distortion; ``k`` has the coefficients of its model."""

    model: str
    k: tuple[float, ...]
    width: int
    height: int
    focal: tuple[float, float]
    centre: tuple[float, float]

    def distorted(self, radius: Array) -> Array:
        """Return how far from the principal point the rays of a tangent are, in focal lengths."""
        if self.model == "fisheye":
            angle = np.arctan(radius)
            powers = [each * angle ** (2 * n + 2) for n, each in enumerate(self.k)]
            return np.asarray(angle * (1 + sum(powers)))
        powers = [each * radius ** (2 * n + 2) for n, each in enumerate(self.k)]
        return np.asarray(radius * (1 + sum(powers)))

    def pixels(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return the pixels of the rays (x, y, 1)."""
        radius = np.hypot(x, y)
        scale = self.distorted(radius) / np.maximum(radius, 1e-12)
        (fx, fy), (cx, cy) = self.focal, self.centre
        return fx * x * scale + cx, fy * y * scale + cy

    @cached_property
    def rays(self) -> tuple[Array, Array]:
        """Return the x and y of the ray (x, y, 1) of each pixel, (height, width) each."""
        table = np.linspace(0, 3, 100_001)
        bent = self.distorted(table)
        unfolded = int(np.argmax(np.diff(bent) <= 0)) or len(table)
        columns, rows = np.meshgrid(np.arange(self.width), np.arange(self.height))
        (fx, fy), (cx, cy) = self.focal, self.centre
        x, y = (columns - cx) / fx, (rows - cy) / fy
        far = np.hypot(x, y)
        assert far.max() < bent[unfolded - 1]
        scale = np.interp(far, bent[:unfolded], table[:unfolded]) / np.maximum(far, 1e-12)
        return x * scale, y * scale

    def image(self, scene: Callable[[Array, Array], Array]) -> Pixels:
        """Return the image of a scene, which gives the grey level of a ray (x, y, 1)."""
        return np.asarray(np.rint(scene(*self.rays)), np.uint8)

    def retaken(self, image: Pixels, focal: float) -> Pixels:
        """Return the image that the camera takes of what a pinhole camera's image shows."""
        x, y = self.rays
        height, width = image.shape[:2]
        columns = (focal * x + (width - 1) / 2).astype(np.float32)
        rows = (focal * y + (height - 1) / 2).astype(np.float32)
        assert columns.min() >= -1
        assert rows.min() >= -1
        assert columns.max() <= width
        assert rows.max() <= height
        return np.asarray(cv2.remap(image, columns, rows, cv2.INTER_LINEAR), np.uint8)

    @property
    def calibration(self) -> Calibration:
        distortion = self.k if self.model == "fisheye" else (*self.k, 0.0, 0.0)
        return Calibration.model_validate(
            {
                "model": self.model,
                "width": self.width,
                "height": self.height,
                "focal": self.focal,
                "centre": self.centre,
                "distortion": distortion,
            }
        )

    def write(self, file: Path) -> Path:
        """Write the calibration as ``camera_calibration`` of ROS does."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        model = "equidistant" if self.model == "fisheye" else "plumb_bob"
        distortion = [*self.calibration.distortion]
        file.write_text(
            f"""image_width: {self.width}
image_height: {self.height}
camera_name: front
camera_matrix:
  rows: 3
  cols: 3
  data: [{fx}, 0.00000, {cx}, 0.00000, {fy}, {cy}, 0.00000, 0.00000, 1.00000]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {len(distortion)}
  data: {distortion}
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.00000, 0.00000, 0.00000, 0.00000, 1.00000, 0.00000, 0.00000, 0.00000, 1.00000]
projection_matrix:
  rows: 3
  cols: 4
  data: [{fx}, 0.00000, {cx}, 0.0, 0.00000, {fy}, {cy}, 0.0, 0.00000, 0.00000, 1.00000, 0.0]
"""
        )
        return file


def pinhole(width: int, height: int, focal: float) -> Lens:
    """Return a camera without distortion, whose principal point is in the middle."""
    centre = (width - 1) / 2, (height - 1) / 2
    return Lens("pinhole", (0.0, 0.0), width, height, (focal, focal), centre)


STRAIGHT = pinhole(96, 72, 60)
"""A camera of the frames that the tests make up."""

BENT = Lens("fisheye", (0.0, 0.0, 0.0, 0.0), 96, 72, (78.0, 78.0), (47.5, 35.5))
"""A camera with a fisheye lens, which takes the same scenes."""
