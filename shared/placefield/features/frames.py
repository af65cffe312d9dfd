"""Frames: an image with its stamp, pose and odometry."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.features.images import pixels_of
from placefield.pose import Pose

__all__ = ["Frame", "Pose"]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One frame of a traverse.

    Attributes:
        index: the frame's position in its source.
        stamp_ns: when the frame was taken, nanoseconds.
        name: used in messages, for example the name of a file.
        image: an encoded image, or pixels: uint8, (H, W) grey or (H, W, 3) BGR.
        pose: of the vehicle; None if unknown.
        odometry_m: metres travelled since any fixed start, 0 or more; it never descends within a
            traverse. None: there was no reading since the frame before.
        fault: why the source could not read the image; ``image`` is then empty bytes, and the frame
            keeps its index.
    """

    index: int
    stamp_ns: int
    name: str
    image: bytes | NDArray[np.uint8]
    pose: Pose | None = None
    odometry_m: float | None = None
    fault: str = ""

    def __repr__(self) -> str:
        image = self.image
        held = f"{len(image)} bytes" if isinstance(image, bytes) else f"pixels {image.shape}"
        about = f"{self.name!r}, {held}" + (f", {self.pose}" if self.pose is not None else "")
        return f"Frame({self.index}, {about})"

    def pixels(self) -> NDArray[np.uint8]:
        """Return the image decoded, (H, W) grey or (H, W, 3) BGR.

        Raises:
            FrameError: the image cannot be read.
        """
        if self.fault:
            raise FrameError(self.fault)
        return pixels_of(self.image)
