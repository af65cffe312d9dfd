"""Traverses of the demo street: the frames of a drive, by day or at dusk, in a folder."""

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from placefield.errors import ConfigError
from placefield.files import write_whole
from placefield_tools.demo.light import LIGHTINGS, Light, develop
from placefield_tools.demo.scene import draw_scene, make_scene
from placefield_tools.demo.street_layout import make_street
from placefield_tools.demo.traffic import LANE, make_traffic

RATE = 10.0  # frames per second
SPEED = 15.0  # metres per second
JPEG_QUALITY = 92


def render_traverse(
    folder: Path,
    light: Light,
    *,
    frames: int = 200,
    seed: int = 0,
    on_frame: Callable[[int], None] | None = None,
) -> None:
    """Render a traverse of the street of `seed` into `folder`: `00000.jpg` … and `frames.csv`.

    Frames are 320 x 240 pixels in colour, 1.5 m and 0.1 s apart. The table has a row per frame:
    file, stamp in seconds, and the camera's pose: x and y in metres, yaw in radians,
    counter-clockwise from the x axis. Both lights show the same street; clouds, traffic and noise
    differ, and at dusk the camera drives 0.3 to 0.6 m further left. The same arguments give the
    same bytes. `on_frame` is called with the number of each frame once it is written.

    Raises:
        ConfigError: `frames` is less than 1.
    """
    if frames < 1:
        raise ConfigError(f"frames is {frames}: a traverse needs at least 1")
    folder.mkdir(parents=True, exist_ok=True)
    lighting, tag = LIGHTINGS[light], list(LIGHTINGS).index(light)
    length = frames * SPEED / RATE
    street = make_street(seed, length)
    scene = make_scene(street, lighting, [seed, 6, tag])
    traffic = make_traffic([seed, 7, tag], length, SPEED)
    rng = np.random.default_rng([seed, 8, tag])
    rows = ["file,stamp,x,y,yaw"]
    for number in range(frames):
        stamp = number / RATE
        arc = stamp * SPEED
        offset = -LANE + _shift(light, arc)
        drawn = draw_scene(scene, arc, offset, [car.at(stamp) for car in traffic])
        file = f"{number:05d}.jpg"
        _, jpeg = cv2.imencode(
            ".jpg", develop(drawn, lighting, rng), (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY)
        )
        (folder / file).write_bytes(jpeg.tobytes())
        x, y, _ = street.route.point(arc, offset)
        rows.append(f"{file},{stamp:.1f},{x:.3f},{y:.3f},{street.route.heading(arc):.5f}")
        if on_frame:
            on_frame(number)
    write_whole(folder / "frames.csv", "\n".join(rows) + "\n")


def _shift(light: Light, arc: float) -> float:
    """Return how far left of its lane, in metres, the camera drives at `arc`."""
    return 0.0 if light == "day" else 0.45 + 0.15 * math.sin(arc / 40.0)
