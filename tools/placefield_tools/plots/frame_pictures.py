"""Frames of a route as they are shown in pictures."""

from collections.abc import Callable, Iterable

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

PictureOf = Callable[[int], NDArray[np.uint8]]
"""Gives the frame of a place, (H, W) grey or (H, W, 3) BGR, uint8."""


def read_pictures(picture_of: PictureOf, places: Iterable[int]) -> dict[int, NDArray[np.uint8]]:
    """Ask for the frame of each place once.

    Raises:
        ValueError: a frame is neither grey nor BGR, is empty, or is not uint8.

    """
    pictures = {place: picture_of(place) for place in sorted(set(places))}
    for place, image in pictures.items():
        grey, colour = image.ndim == 2, image.ndim == 3 and image.shape[2] == 3
        if not (grey or colour) or not image.size or image.dtype != np.uint8:
            raise ValueError(
                f"the frame of place {place} is {image.dtype} of shape {image.shape}: "
                "it has to be uint8, (H, W) grey or (H, W, 3) BGR"
            )
    return pictures


def height_per_width(images: Iterable[NDArray[np.uint8]]) -> float:
    """Give the ratio of the tallest of the pictures when all are equally wide."""
    return max(float(image.shape[0] / image.shape[1]) for image in images)


def shown(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Turn BGR into the RGB that Matplotlib wants; grey stays as it is."""
    return image if image.ndim == 2 else image[..., ::-1]


def draw_picture(
    axes: Axes, image: NDArray[np.uint8], left: float, top: float, width: float
) -> None:
    """Draw the frame with its upper left corner at (left, top) of axes whose ordinates fall."""
    height = width * image.shape[0] / image.shape[1]
    axes.imshow(
        shown(image),
        cmap="gray",
        vmin=0,
        vmax=255,
        extent=(left, left + width, top + height, top),
        zorder=2,
    )
