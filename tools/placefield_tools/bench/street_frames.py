"""Frames to benchmark with: a pan along pictures of the demo street."""

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.light import LIGHTINGS
from placefield_tools.demo.pinhole_camera import HEIGHT, WIDTH
from placefield_tools.demo.scene import draw_scene, make_scene
from placefield_tools.demo.street_layout import make_street
from placefield_tools.demo.traffic import LANE

_STEP = 20  # pixels from frame to frame
_APART = 12.0  # metres from picture to picture
_JPEG_QUALITY = 90

Image = NDArray[np.uint8]


def street_frames(
    count: int, *, size: tuple[int, int] = (WIDTH, HEIGHT), shift: int = 0
) -> list[bytes]:
    """Make so many JPEGs of which each shows another place, at a small part of a rendering's cost.

    Args:
        count: how many; at 640 x 480 they have about 90 kB.
        size: width and height, pixels.
        shift: pixels that all frames are moved to the side, up to 20: another drive.
    """
    wall = _wall(WIDTH + (count + 1) * _STEP)
    quality = (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY)
    frames = []
    for left in range(shift, shift + count * _STEP, _STEP):
        small = cv2.resize(wall[:, left : left + WIDTH], size, interpolation=cv2.INTER_AREA)
        frames.append(cv2.imencode(".jpg", small, quality)[1].tobytes())
    return frames


def write_frames(folder: Path, frames: Sequence[bytes]) -> Path:
    """Write JPEGs into a folder, which is made, in the order of their names; return it."""
    folder.mkdir()
    for number, frame in enumerate(frames):
        (folder / f"{number:05}.jpg").write_bytes(frame)
    return folder


def _wall(width: int) -> Image:
    """Hang pictures of the street side by side, (HEIGHT, at least width, 3)."""
    pictures = math.ceil(width / WIDTH)
    lighting = LIGHTINGS["day"]
    scene = make_scene(make_street(0, pictures * _APART), lighting, [0])
    drawn = [draw_scene(scene, number * _APART, -LANE, []) for number in range(pictures)]
    return np.concatenate(drawn, axis=1)
