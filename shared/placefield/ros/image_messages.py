"""Decodes ROS image messages to pixels, with no ROS installed.

A ``sensor_msgs/Image`` has rows of ``step`` bytes, with padding behind the pixels of each row, and
an encoding of ``sensor_msgs/image_encodings.hpp``. We read the encodings of camera images. A
``sensor_msgs/CompressedImage`` is a JPEG or PNG, like any encoded frame.
"""

from typing import NamedTuple

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.features.images import MAX_PIXELS, MIN_SIDE


class _Layout(NamedTuple):
    channels: int
    bits: int = 8
    to_pixels: int | None = None  # OpenCV's conversion to grey or BGR


# A Bayer encoding is named after its first four pixels, row by row.
_LAYOUTS = {
    "mono8": _Layout(1),
    "8UC1": _Layout(1),
    "mono16": _Layout(1, 16),
    "16UC1": _Layout(1, 16),
    "bgr8": _Layout(3),
    "8UC3": _Layout(3),
    "rgb8": _Layout(3, 8, cv2.COLOR_RGB2BGR),
    "bgra8": _Layout(4, 8, cv2.COLOR_BGRA2BGR),
    "rgba8": _Layout(4, 8, cv2.COLOR_RGBA2BGR),
    "bgr16": _Layout(3, 16),
    "rgb16": _Layout(3, 16, cv2.COLOR_RGB2BGR),
    "yuv422": _Layout(2, 8, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": _Layout(2, 8, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": _Layout(2, 8, cv2.COLOR_YUV2BGR_YUYV),
    "yuyv": _Layout(2, 8, cv2.COLOR_YUV2BGR_YUYV),
} | {
    f"bayer_{pattern}{bits}": _Layout(1, bits, conversion)
    for pattern, conversion in (
        ("rggb", cv2.COLOR_BayerRGGB2BGR),
        ("bggr", cv2.COLOR_BayerBGGR2BGR),
        ("gbrg", cv2.COLOR_BayerGBRG2BGR),
        ("grbg", cv2.COLOR_BayerGRBG2BGR),
    )
    for bits in (8, 16)
}

ENCODINGS = tuple(_LAYOUTS)
"""The encodings that ``decode_image`` reads."""


def decode_image(
    height: int,
    width: int,
    encoding: str,
    is_bigendian: bool,
    step: int,
    data: bytes | NDArray[np.uint8],
) -> NDArray[np.uint8]:
    """Decode the fields of a ``sensor_msgs/Image``.

    Args:
        height: rows.
        width: pixels of a row.
        encoding: one of ``ENCODINGS``.
        is_bigendian: the order of the bytes of 16-bit values.
        step: bytes from one row to the next.
        data: at least ``step`` bytes for every row but the last, which may lack its padding.

    Returns:
        (H, W) grey or (H, W, 3) BGR uint8, a copy. 16-bit values are scaled by 1/257 as in an
        encoded image, alpha is dropped, and a Bayer pattern is demosaiced bilinearly.

    Raises:
        FrameError: the encoding is not in ``ENCODINGS``, or the fields do not fit each other.
    """
    layout = _LAYOUTS.get(encoding)
    if layout is None:
        raise FrameError(
            f"the image's encoding is {encoding!r}; give one of {', '.join(ENCODINGS)}"
        )
    _check_size(height, width)
    values: MatLike = _rows(height, width, layout, step, data)
    if layout.bits == 16:
        values = values.view(">u2" if is_bigendian else "<u2").astype(np.uint16)
    if layout.channels > 1:
        values = values.reshape(height, width, layout.channels)
    if layout.to_pixels is not None:
        values = _converted(values, layout.to_pixels)
    if layout.bits == 16:
        values = cv2.convertScaleAbs(values, alpha=1 / 257)
    return np.asarray(values, np.uint8)


def _check_size(height: int, width: int) -> None:
    if min(height, width) < MIN_SIDE or height * width > MAX_PIXELS:
        raise FrameError(
            f"the image is {width}×{height}; give at least {MIN_SIDE}×{MIN_SIDE} "
            f"and at most {MAX_PIXELS} pixels"
        )


def _rows(
    height: int, width: int, layout: _Layout, step: int, data: bytes | NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Return the rows without their padding, (H, bytes of a row), contiguous."""
    row = width * layout.channels * layout.bits // 8
    given = np.frombuffer(data, np.uint8)
    needed = (height - 1) * step + row
    if step < row or len(given) < needed:
        raise FrameError(
            f"the image of {width}×{height} has {len(given)} bytes in rows of {step}; "
            f"it needs rows of {row} or more, and {max(needed, height * row)} bytes"
        )
    rows = np.lib.stride_tricks.as_strided(given, (height, row), (step, 1), writeable=False)
    return rows.copy()


def _converted(values: MatLike, conversion: int) -> MatLike:
    try:
        return cv2.cvtColor(values, conversion)
    except cv2.error:
        raise FrameError(
            f"the image of {values.shape[1]}×{values.shape[0]} does not fit its encoding: "
            "4:2:2 needs an even width"
        ) from None
