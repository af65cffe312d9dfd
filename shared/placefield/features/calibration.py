"""The calibration of a camera, and the view of a pinhole camera.

They are data only; ``rectification`` renders images.
"""

import math
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from placefield.errors import FrameError
from placefield.features.aspect import have_one_aspect

WIDEST = math.tan(math.radians(60))
"""The most of half a view's width: more is stretched too much at the border."""

_COEFFICIENTS = {"pinhole": (0, 4, 5, 8, 12, 14), "fisheye": (4,)}

Focal = Annotated[float, Field(gt=0, le=1e6)]
Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Side = Annotated[int, Field(ge=8, lt=2**16)]
HalfSide = Annotated[float, Field(ge=0.01, le=WIDEST)]


class _Data(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Calibration(_Data):
    """The calibration of a camera, in the pixels of an image, as OpenCV and ROS define it.

    The middle of the first pixel is (0, 0).

    Attributes:
        model: ``pinhole``, with the radial, tangential, thin prism and tilt distortion of OpenCV
            (in ROS, ``plumb_bob`` and ``rational_polynomial``), or ``fisheye`` (``equidistant``).
        width: of the calibrated images, pixels.
        height: likewise.
        focal: focal length in x and y, pixels.
        centre: x and y of the principal point, pixels.
        distortion: 0, 4, 5, 8, 12 or 14 coefficients of a pinhole, or 4 of a fisheye.
    """

    model: Literal["pinhole", "fisheye"]
    width: Side
    height: Side
    focal: tuple[Focal, Focal]
    centre: tuple[Number, Number]
    distortion: tuple[Number, ...] = Field(max_length=14)

    @model_validator(mode="after")
    def _check_distortion(self) -> Self:
        allowed = _COEFFICIENTS[self.model]
        if len(self.distortion) not in allowed:
            raise PydanticCustomError(
                "distortion",
                "{given} coefficients, and a {model} has {allowed}",
                {
                    "given": len(self.distortion),
                    "model": self.model,
                    "allowed": " or ".join(map(str, allowed)),
                },
            )
        return self

    def of_size(self, height: int, width: int) -> "Calibration":
        """Return the calibration for images of another size and the same aspect ratio.

        Raises:
            FrameError: the aspect ratio is another.
        """
        if (height, width) == (self.height, self.width):
            return self
        if not have_one_aspect((height, width), (self.height, self.width)):
            raise FrameError(
                f"the image is {width}×{height}, and its camera was calibrated for "
                f"{self.width}×{self.height}, of another aspect ratio"
            )
        scales = width / self.width, height / self.height
        (fx, fy), (cx, cy) = self.focal, self.centre
        return self.model_copy(
            update={
                "width": width,
                "height": height,
                "focal": (fx * scales[0], fy * scales[1]),
                "centre": ((cx + 0.5) * scales[0] - 0.5, (cy + 0.5) * scales[1] - 0.5),
            }
        )


class View(_Data):
    """The view of a pinhole camera without distortion, with its principal point in the middle.

    Attributes:
        half_width: half the width of the image, in focal lengths: the tangent of half the
            horizontal field of view.
        half_height: likewise, vertically.
    """

    half_width: HalfSide
    half_height: HalfSide

    @property
    def focal(self) -> float:
        """The focal length, as a fraction of the image's longest side."""
        return 1 / (2 * max(self.half_width, self.half_height))

    @property
    def degrees(self) -> tuple[float, float]:
        """The horizontal and the vertical field of view, degrees."""
        return (
            2 * math.degrees(math.atan(self.half_width)),
            2 * math.degrees(math.atan(self.half_height)),
        )

    def common(self, other: "View") -> "View":
        """Return the view that is in both."""
        return View(
            half_width=min(self.half_width, other.half_width),
            half_height=min(self.half_height, other.half_height),
        )
