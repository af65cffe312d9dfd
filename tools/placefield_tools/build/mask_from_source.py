"""The mask of a map: read from a file, or learned from the first reference traverse."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.calibration import View
from placefield.features.frames import Frame
from placefield.features.mask import LEARNING_FRAMES, Mask, learn_mask, learning_image, read_mask
from placefield.features.rectification import image_of
from placefield_tools.common.progress import tracked
from placefield_tools.sources import Source
from placefield_tools.sources.frame_content import check_images

AUTO = "auto"
"""Instead of a file: the mask is learned."""


def mask_of(asked: str, source: Source, view: View | None = None) -> Mask | None:
    """Return the mask that ``--mask`` asks for; None if it is learned and nothing is still.

    Args:
        asked: an image file, or ``auto``.
        source: of the first traverse; it is closed at the end.
        view: of the images; None: they are used as they are.

    Raises:
        ConfigError: the frames are descriptors, the image cannot be read or has another aspect
            ratio than the frames, or no mask can be learned (see ``learn_mask``).
        SourceError: the source fails.
    """
    with source:
        check_images(source, "--mask")
        if asked == AUTO:
            with tracked(source, "learning the mask", source.count) as frames:
                return learn_mask(_learning_images(frames, view))
        mask = _read(Path(asked))
        _check_fits(mask, asked, source, view)
        return mask


def _read(file: Path) -> Mask:
    try:
        return read_mask(file.read_bytes(), f"--mask {file}")
    except OSError as error:
        raise ConfigError(f"--mask {file}: cannot be read: {error.strerror}") from None


def _check_fits(mask: Mask, asked: str, frames: Iterable[Frame], view: View | None) -> None:
    """Refuse a mask that does not fit the first frame that can be read."""
    for frame in frames:
        try:
            pixels = image_of(frame, view)
        except FrameError:
            continue
        try:
            mask.of_size(*pixels.shape[:2])
        except FrameError as error:
            raise ConfigError(f"--mask {asked}: {error}") from None
        return


def _learning_images(frames: Iterable[Frame], view: View | None) -> list[NDArray[np.uint8]]:
    """Return small images, evenly from all of a drive, without those that cannot be read."""
    images: list[NDArray[np.uint8]] = []
    every = 1
    for number, frame in enumerate(frames):
        if number % every:
            continue
        try:
            images.append(learning_image(image_of(frame, view)))
        except FrameError:
            continue
        if len(images) == 2 * LEARNING_FRAMES:
            images, every = images[::2], 2 * every
    return images
