"""Day and dusk: how light falls on the street, and how the camera renders it."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Light = Literal["day", "dusk"]
Colour = tuple[float, float, float]  # blue, green, red; 0 to 255, or factors around 1
Image = NDArray[np.uint8]
FRAME_SIZE = (320, 240)  # pixels, width and height


@dataclass(frozen=True)
class Lighting:
    """What tells one light from another.

    Colours of light are factors on a surface's own colour; `zenith`, `horizon` and `haze` are
    pixel values.

    Attributes:
        sun_side: +1 if the sun stands left of the street, -1 if right.
        sun: direct light.
        sun_foot: metres above the street where direct light begins; 0 if the sun is high.
        ambient: light from the whole sky.
        lamp: light of street lamps and shop windows, near the ground; 0 by day.
        zenith: the sky's colour high up.
        horizon: the sky's colour low down.
        glow: the sky's colour low down, towards the sun.
        cloud: colour of lit clouds.
        cloud_shade: colour of the clouds' undersides.
        cover: share of the sky under cloud, 0 to 1.
        haze: what far things fade into.
        lit_rooms: share of windows with light behind them.
        pane: what a dark window reflects.
        spill_above: pixel value above which light spills over its surroundings in the lens.
        spill: how much of it does.
        noise: standard deviation of the sensor's noise, in pixel values.
    """

    sun_side: int
    sun: Colour
    sun_foot: float
    ambient: Colour
    lamp: Colour
    zenith: Colour
    horizon: Colour
    glow: Colour
    cloud: Colour
    cloud_shade: Colour
    cover: float
    haze: Colour
    lit_rooms: float
    pane: Colour
    spill_above: int
    spill: float
    noise: float

    @property
    def lamps_on(self) -> bool:
        """Whether street lamps and headlights burn."""
        return any(self.lamp)

    @property
    def in_street(self) -> Colour:
        """Light on what stands in the street: cars and trees."""
        sun = 0.8 if self.sun_foot == 0 else 0.0
        blue, green, red = (
            ambient + sun * direct + 0.7 * lamp
            for ambient, direct, lamp in zip(self.ambient, self.sun, self.lamp, strict=True)
        )
        return blue, green, red

    def on_facade(self, side: int, heights: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the light (N, 3) on a façade of `side` (+1 left) at `heights` (N,) in metres."""
        direct = np.full_like(heights, side != self.sun_side)
        if self.sun_foot:
            direct *= np.clip((heights - self.sun_foot) / 5.0, 0.0, 1.0)
        lamp = np.exp(-heights / 4.0)
        light = (
            np.array(self.ambient)
            + direct[:, None] * np.array(self.sun)
            + lamp[:, None] * np.array(self.lamp)
        )
        return np.asarray(light, dtype=np.float32)


LIGHTINGS: dict[Light, Lighting] = {
    "day": Lighting(
        sun_side=-1,
        sun=(0.42, 0.50, 0.56),
        sun_foot=0.0,
        ambient=(0.66, 0.61, 0.57),
        lamp=(0.0, 0.0, 0.0),
        zenith=(205, 140, 70),
        horizon=(236, 214, 186),
        glow=(240, 232, 220),
        cloud=(253, 252, 250),
        cloud_shade=(214, 204, 196),
        cover=0.45,
        haze=(226, 212, 194),
        lit_rooms=0.06,
        pane=(150, 122, 98),
        spill_above=205,
        spill=0.5,
        noise=1.2,
    ),
    "dusk": Lighting(
        sun_side=1,
        sun=(0.10, 0.28, 0.58),
        sun_foot=5.0,
        ambient=(0.40, 0.27, 0.21),
        lamp=(0.07, 0.20, 0.32),
        zenith=(118, 66, 30),
        horizon=(150, 120, 118),
        glow=(84, 140, 236),
        cloud=(120, 116, 178),
        cloud_shade=(104, 72, 62),
        cover=0.40,
        haze=(118, 92, 88),
        lit_rooms=0.45,
        pane=(92, 66, 48),
        spill_above=150,
        spill=0.8,
        noise=4.0,
    ),
}


def develop(drawn: Image, lighting: Lighting, rng: np.random.Generator) -> Image:
    """Return the frame, `FRAME_SIZE`, that a camera makes of what was drawn, (H, W, 3).

    Bright light spills over what is beside it, and the sensor adds noise.
    """
    frame = cv2.resize(drawn, FRAME_SIZE, interpolation=cv2.INTER_AREA)
    half = cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    bright = cv2.subtract(half, np.full_like(half, lighting.spill_above))
    near, far = (cv2.GaussianBlur(bright, (0, 0), sigma) for sigma in (2.0, 7.0))
    halo = cv2.addWeighted(near, lighting.spill, far, lighting.spill, 0.0)
    frame = cv2.add(frame, cv2.resize(halo, FRAME_SIZE, interpolation=cv2.INTER_LINEAR))
    grey = rng.standard_normal((*frame.shape[:2], 1), dtype=np.float32)
    coloured = rng.standard_normal(frame.shape, dtype=np.float32)
    noisy = frame + lighting.noise * (grey + 0.7 * coloured)
    return np.clip(noisy, 0, 255).astype(np.uint8)
