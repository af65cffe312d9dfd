"""Masks: a part of the image that is not used, as a bonnet or a burnt-in clock.

A mask is learned from a drive: it hides what never changes while the vehicle moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.aspect import have_one_aspect
from placefield.features.images import check_pixels, decode

Pixels = NDArray[np.uint8]

LEARNING_FRAMES = 200
"""The most frames of a drive that a mask is learned from."""

LEAST_FRAMES = 20
"""The fewest frames of a drive that a mask is learned from."""

_LONGEST = 320  # pixels of the longer side of a mask that is learned
_STILL = 0.2  # of the median range of grey: a pixel whose range is smaller does not change
_BRIDGED, _IGNORED, _MARGIN = 0.05, 0.01, 0.01  # of the longer side
_MOST_HIDDEN = 0.6  # of the image


@dataclass(frozen=True, eq=False)
class Mask:
    """The part of the image that is used; the rest is hidden.

    Attributes:
        used: (H, W) uint8, 1 where the image is used and 0 where it is hidden. It is scaled to
            images of another size and of the same aspect ratio.
    """

    used: Pixels

    def __repr__(self) -> str:
        height, width = self.used.shape
        return f"Mask({width}×{height}, {self.hidden:.0%} hidden)"

    @property
    def hidden(self) -> float:
        """The fraction of the image that is hidden."""
        return 1 - float(self.used.mean())

    def apply(self, pixels: Pixels) -> Pixels:
        """Return pixels (H, W) or (H, W, 3) uint8; hidden ones are as the nearest used one.

        So no edge appears at the mask's border, which would depend on the light.

        Raises:
            FrameError: the image has another aspect ratio than the mask, or is no image.
        """
        check_pixels(pixels)
        hidden, nearest = _replacements(self, *pixels.shape[:2])
        masked = pixels.copy()
        flat = masked.reshape(len(masked) * masked.shape[1], -1)
        flat[hidden] = flat[nearest]
        return masked

    def of_size(self, height: int, width: int) -> Pixels:
        """Return ``used`` for images of this size.

        Raises:
            FrameError: the size has another aspect ratio.
        """
        rows, columns = self.used.shape
        if not have_one_aspect((height, width), (rows, columns)):
            raise FrameError(
                f"the image is {width}×{height}, and its mask is {columns}×{rows}, of another "
                "aspect ratio"
            )
        if (rows, columns) == (height, width):
            return self.used
        scaled = cv2.resize(self.used, (width, height), interpolation=cv2.INTER_NEAREST)
        return np.asarray(scaled, np.uint8)


def read_mask(image: bytes, name: str) -> Mask:
    """Read a mask from an encoded image: black is hidden, and any other colour is used.

    Args:
        image: PNG or another format without loss.
        name: used in messages.

    Raises:
        ConfigError: the image does not decode, or all of it is black.
    """
    try:
        pixels = decode(image)
    except FrameError as error:
        raise ConfigError(f"{name}: {error}") from None
    used = np.asarray(np.max(np.atleast_3d(pixels), axis=2) > 0, np.uint8)
    if not used.any():
        raise ConfigError(f"{name}: hides the whole image; paint white what is to be used")
    return Mask(used)


def learning_image(pixels: Pixels) -> Pixels:
    """Return an image (H, W) or (H, W, 3) as a small grey one (h, w), to learn a mask from."""
    check_pixels(pixels)
    luma = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    scale = min(1.0, _LONGEST / max(luma.shape))
    height, width = (max(1, round(side * scale)) for side in luma.shape)
    return np.asarray(cv2.resize(luma, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def learn_mask(images: Sequence[Pixels]) -> Mask | None:
    """Hide what never changes along a drive; return None if everything changes.

    A pixel is still if its grey levels, from the 10th to the 90th percentile, have a range of less
    than a fifth of the median range of all pixels. What lies between still pixels, as the digits of
    a clock, is hidden with them.

    Args:
        images: n small grey images (h, w) of one size, from all of the drive, see
            ``learning_image``.

    Raises:
        ConfigError: there are fewer than ``LEAST_FRAMES`` images, their sizes differ, or more than
            60 % of the image never changes.
    """
    if len(images) < LEAST_FRAMES:
        raise ConfigError(
            f"mask auto: {len(images)} frames, and at least {LEAST_FRAMES} are needed; give a mask "
            "as an image"
        )
    if len({image.shape for image in images}) > 1:
        raise ConfigError("mask auto: the frames are of several sizes; give a mask as an image")
    low, high = np.percentile(np.stack(images), (10, 90), axis=0)
    spread = high - low
    used = _without_specks(spread >= _STILL * np.median(spread))
    hidden = 1 - float(used.mean())
    if hidden > _MOST_HIDDEN or not spread.any():
        raise ConfigError(
            f"mask auto: {hidden:.0%} of the image never changes; does the vehicle move? Give a "
            "mask as an image"
        )
    return Mask(used) if hidden else None


@lru_cache(maxsize=4)
def _replacements(mask: Mask, height: int, width: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the hidden pixels of an image, and the nearest used one to each; row by row."""
    hidden = 1 - mask.of_size(height, width)
    _, labels = cv2.distanceTransformWithLabels(
        hidden, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    pixel_of = np.zeros(int(labels.max()) + 1, np.intp)  # each used pixel has a label of its own
    used = np.flatnonzero(hidden == 0)
    pixel_of[labels.ravel()[used]] = used
    replaced = np.flatnonzero(hidden)
    return replaced, pixel_of[labels.ravel()[replaced]]


def _without_specks(changes: NDArray[np.bool_]) -> Pixels:
    """Return the used part: still specks are used, and what lies between still pixels is not."""
    longest = max(changes.shape)

    def kernel(share: float) -> Pixels:
        side = 2 * round(share * longest / 2) + 1
        return np.ones((side, side), np.uint8)

    # the border repeats the image, so that it neither hides nor uses what is beside it
    border = round(_BRIDGED * longest)
    still = np.pad((~changes).astype(np.uint8), border, mode="edge")
    bridged = cv2.morphologyEx(still, cv2.MORPH_CLOSE, kernel(_BRIDGED))
    cleaned = cv2.morphologyEx(bridged, cv2.MORPH_OPEN, kernel(_IGNORED))
    hidden = cv2.dilate(cleaned, kernel(_MARGIN))[border:-border, border:-border]
    return np.asarray(1 - hidden, np.uint8)
