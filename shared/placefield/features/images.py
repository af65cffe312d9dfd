"""Decoding and encoding of images, and conversion to grey.

Images are rotated as their EXIF data say.
"""

import re
from pathlib import Path

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from placefield.errors import FrameError, SourceError

Image = bytes | NDArray[np.uint8] | Path
"""An encoded image, pixels (H, W) or (H, W, 3) BGR uint8, or the file that an image is in."""

MIN_SIDE = 8
MAX_PIXELS = 64_000_000
MAX_SCANS = 100
"""The most scans of a progressive JPEG: each costs a decoding; cameras write about ten."""

_JPEG_QUALITY = 80

_AS_IT_IS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR  # and rotated by EXIF
# The flags say grayscale, but with ANYCOLOR colours stay.
_REDUCED = {
    8: cv2.IMREAD_REDUCED_GRAYSCALE_8,
    4: cv2.IMREAD_REDUCED_GRAYSCALE_4,
    2: cv2.IMREAD_REDUCED_GRAYSCALE_2,
}

_JPEG_SIGNATURE = b"\xff\xd8"
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"

# ITU-T T.81, table B.1. Inside a scan 0xFF also comes stuffed with 0x00, as a restart marker
# (D0 to D7), and as a fill byte in front of another 0xFF: none of these ends the scan.
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xd0-\xd7\xff])")
_JPEG_START, _JPEG_END, _JPEG_SCAN = 0xD8, 0xD9, 0xDA
_JPEG_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def load(image: Image) -> bytes | NDArray[np.uint8]:
    """Return an image; a path is read as a file.

    Raises:
        SourceError: the file cannot be read, or the value is no image.
    """
    if isinstance(image, Path):
        try:
            return image.read_bytes()
        except OSError as error:
            raise SourceError(f"{image}: cannot be read ({error.strerror})") from None
    if not isinstance(image, (bytes, np.ndarray)):
        raise SourceError(f"an image as {type(image).__name__}: give bytes, pixels or a Path")
    return image


def decode(data: bytes, least_side: int | None = None) -> NDArray[np.uint8]:
    """Decode an image (JPEG, PNG, BMP, PNM, TIFF, WebP) to (H, W) grey or (H, W, 3) BGR uint8.

    A JPEG may be decoded to 1/2, 1/4 or 1/8 of its size, which costs less than to decode it whole,
    see ``reduction``.

    16-bit values are scaled by 1/257, so that full range stays full range; alpha is dropped;
    palettes are resolved. Bytes after the end of the image are ignored. The size of JPEG and PNG is
    checked before any pixel is decoded, that of other formats afterwards.

    Args:
        data: the encoded image.
        least_side: pixels that the shorter side has at least after a reduction; None: the image is
            decoded whole.

    Raises:
        FrameError: the data are empty, no image, cut off, not of 8 or 16 bits, less than
            ``MIN_SIDE`` pixels wide or high, or of more than ``MAX_PIXELS`` pixels or
            ``MAX_SCANS`` scans.
    """
    declared = _declared_size(data)
    flags = _AS_IT_IS
    if declared is not None:
        _check_size(*declared)
        if least_side is not None and data.startswith(_JPEG_SIGNATURE):
            flags |= _REDUCED.get(reduction(*declared, least_side), 0)
    pixels = _decode(data, flags)
    _check_size(*pixels.shape[:2])
    if pixels.dtype == np.uint16:
        pixels = cv2.convertScaleAbs(pixels, alpha=1 / 257)
    elif pixels.dtype != np.uint8:
        raise FrameError(f"the image's pixels are {pixels.dtype}; give 8 or 16 bits a channel")
    return np.asarray(pixels, np.uint8)


def reduction(height: int, width: int, least_side: int) -> int:
    """Return the largest n of 1, 2, 4 and 8 to which a JPEG may be decoded as 1/n of its size.

    The shorter side keeps at least ``least_side`` pixels, and n divides both sides. So the aspect
    ratio stays the same, and a calibration or a mask fits as well as before.
    """
    for n in _REDUCED:
        if min(height, width) >= n * least_side and height % n == 0 and width % n == 0:
            return n
    return 1


def pixels_of(image: bytes | NDArray[np.uint8], least_side: int | None = None) -> NDArray[np.uint8]:
    """Return the pixels of an image: an encoded one is decoded, and pixels are returned unchanged.

    Args:
        image: encoded, or pixels.
        least_side: see ``decode``.

    Raises:
        FrameError: the image does not decode, see ``decode``.
    """
    return decode(image, least_side) if isinstance(image, bytes) else image


def small_jpeg(pixels: NDArray[np.uint8], longest: int) -> bytes:
    """Encode pixels (H, W) or (H, W, 3) BGR as JPEG, downscaled to sides of ``longest`` at most."""
    height, width = pixels.shape[:2]
    scale = longest / max(height, width)
    if scale < 1:
        size = max(1, round(width * scale)), max(1, round(height * scale))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()


def grey(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Average the colour channels of (H, W) or (H, W, 3) uint8 to (H, W) float32 in 0 … 255.

    The unweighted mean is GIST's convention; the luma of JPEG is weighted.

    Raises:
        FrameError: the shape or dtype is another, or there are no pixels.
    """
    check_pixels(image)
    if image.ndim == 2:
        return image.astype(np.float32)
    # Three bytes sum exactly in float32, and OpenCV sums them many times faster than np.mean.
    total = cv2.transform(image.astype(np.float32), np.ones((1, 3), np.float32))
    return np.divide(total, 3, dtype=np.float32)


def check_pixels(image: NDArray[np.uint8]) -> None:
    """Refuse pixels that are not uint8, (H, W) or (H, W, 3), or empty.

    Raises:
        FrameError: the pixels are refused.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
        raise FrameError(
            f"pixels are {image.dtype} of shape {image.shape}; give uint8, (H, W) or (H, W, 3)"
        )
    if not image.size:
        raise FrameError(f"the image of shape {image.shape} has no pixels")


def _declared_size(data: bytes) -> tuple[int, int] | None:
    """Return the (height, width) in the header of a JPEG or a PNG; None for other formats."""
    if data.startswith(_JPEG_SIGNATURE):
        return _jpeg_size(data)
    if data.startswith(_PNG_SIGNATURE):
        return int.from_bytes(data[20:24], "big"), int.from_bytes(data[16:20], "big")
    return None


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """Return the (height, width) in a JPEG's frame header, after a walk over all its markers.

    If a JPEG was cut off, and padding or another JPEG follows, OpenCV decodes an image whose lower
    part is wrong. Only a walk over the markers distinguishes the image's own end marker from that
    of a thumbnail.

    Raises:
        FrameError: the end marker is missing, or there are more than ``MAX_SCANS`` scans.
    """
    height = width = scans = 0
    at = 2
    while found := _JPEG_MARKER.search(data, at):
        marker, at = found[1][0], found.end()
        if marker == _JPEG_END:
            return height, width
        if marker == _JPEG_START:
            break
        scans += marker == _JPEG_SCAN
        if scans > MAX_SCANS:
            raise FrameError(f"the JPEG has more than {MAX_SCANS} scans; save it with fewer")
        if marker in _JPEG_FRAME_HEADERS:
            height = int.from_bytes(data[at + 3 : at + 5], "big")
            width = int.from_bytes(data[at + 5 : at + 7], "big")
        at += int.from_bytes(data[at : at + 2], "big")
    raise FrameError(f"the JPEG of {len(data)} bytes is cut off: its end marker is missing")


def _decode(data: bytes, flags: int) -> MatLike:
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:  # empty data, or more pixels than OpenCV allows
        pixels = None
    if pixels is None:
        raise FrameError(f"{len(data)} bytes do not decode as an image: damaged, or no image")
    return pixels


def _check_size(height: int, width: int) -> None:
    if min(height, width) < MIN_SIDE:
        raise FrameError(f"the image is {width}×{height}; give at least {MIN_SIDE}×{MIN_SIDE}")
    if height * width > MAX_PIXELS:
        raise FrameError(f"the image is {width}×{height}; give at most {MAX_PIXELS} pixels")
