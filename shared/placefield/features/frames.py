"""What a camera gave at one instant."""

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

    ``index`` is the frame's position in its source, ``stamp_ns`` the time it was taken in
    nanoseconds, ``name`` what to call it in a message for a person (a file's name, say).
    ``image`` is an encoded image as it lies in its file, or pixels: uint8, (H, W) grey or
    (H, W, 3) BGR. ``odometry_m`` is how far the vehicle had travelled, in metres since any fixed
    start, 0 or more; within a traverse it never goes down. None: nobody has said since the frame
    before. ``fault`` says why the source could not read the image, which is empty bytes then: the
    frame keeps its turn.
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
            FrameError: it cannot be read.
        """
        if self.fault:
            raise FrameError(self.fault)
        return pixels_of(self.image)
