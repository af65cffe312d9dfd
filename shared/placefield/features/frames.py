"""Frames: an image or a given descriptor, with its stamp, pose and odometry."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.features.calibration import Calibration
from placefield.features.images import pixels_of
from placefield.pose import Pose

__all__ = ["Frame", "GivenDescriptor", "Pose"]

GivenDescriptor = NDArray[np.float16] | NDArray[np.float32]
"""A descriptor (D,) that another program made of an image."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One frame of a traverse.

    Attributes:
        index: the frame's position in its source.
        stamp_ns: when the frame was taken, nanoseconds.
        name: used in messages, for example the name of a file.
        image: an encoded image, or pixels: uint8, (H, W) grey or (H, W, 3) BGR. Empty bytes if
            there is a descriptor instead.
        pose: of the vehicle; None if unknown.
        odometry_m: metres travelled since any fixed start, 0 or more; it never descends within a
            traverse. None: there was no reading since the frame before.
        fault: why the source could not read the frame; ``image`` is then empty bytes, and the frame
            keeps its index.
        descriptor: (D,), given instead of an image; None: the frame has an image.
        calibration: of the camera that took the image; None if unknown.
    """

    index: int
    stamp_ns: int
    name: str
    image: bytes | NDArray[np.uint8] = b""
    pose: Pose | None = None
    odometry_m: float | None = None
    fault: str = ""
    descriptor: GivenDescriptor | None = None
    calibration: Calibration | None = None

    def __repr__(self) -> str:
        image = self.image
        held = f"{len(image)} bytes" if isinstance(image, bytes) else f"pixels {image.shape}"
        if self.descriptor is not None:
            held = f"descriptor {self.descriptor.shape}"
        about = f"{self.name!r}, {held}" + (f", {self.pose}" if self.pose is not None else "")
        return f"Frame({self.index}, {about})"

    def pixels(self, least_side: int | None = None) -> NDArray[np.uint8]:
        """Return the image decoded, (H, W) grey or (H, W, 3) BGR.

        Args:
            least_side: see ``images.decode``; None: the whole image.

        Raises:
            FrameError: the image cannot be read, or there is a descriptor instead.
        """
        if self.fault:
            raise FrameError(self.fault)
        if self.descriptor is not None:
            raise FrameError("a descriptor, where an image is needed")
        return pixels_of(self.image, least_side)
