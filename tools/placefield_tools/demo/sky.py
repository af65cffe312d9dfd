"""The sky with its clouds, and the skyline beyond the street, all around."""

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.light import Image, Lighting
from placefield_tools.demo.pinhole_camera import FOCAL, HEIGHT, HORIZON, WIDTH
from placefield_tools.demo.texture import fractal_noise

AROUND = round(2 * np.pi * FOCAL)  # columns of the panorama
SUN_BEARING = 0.55  # radians off the street's general direction, to the side where the sun stands
CLOUD_TILE = 1024


def paint_panorama(lighting: Lighting, street_seed: int, cloud_seed: list[int]) -> Image:
    """Return the sky all around, uint8 (`HEIGHT`, `AROUND` + `WIDTH`, 4).

    The clouds come from `cloud_seed`, the skyline from `street_seed`. The last `WIDTH` columns
    repeat the first, so that every view is one slice. Below the horizon lies haze.
    """
    rows = np.arange(int(HORIZON) + 1)
    elevation = np.arctan(np.maximum(HORIZON - rows, 0.5) / FOCAL)[:, None]
    bearing = np.arange(AROUND)[None, :] / FOCAL
    sky = _gradient(lighting, elevation, bearing)
    cover, shade = _clouds(lighting, elevation, bearing, np.random.default_rng(cloud_seed))
    warm = _towards_sun(lighting, bearing, 1.0) * np.exp(-elevation / 0.25)
    cloud = np.array(lighting.cloud_shade) * shade + np.array(lighting.cloud) * (1 - shade)
    cloud = cloud + warm[..., None] * 0.5 * (np.array(lighting.glow) - cloud)
    sky += cover * (cloud - sky)
    _draw_skyline(sky, lighting, np.random.default_rng([street_seed, 23]))
    image = np.full((HEIGHT, AROUND + WIDTH, 4), 255, np.uint8)
    image[:, :, :3] = lighting.haze
    image[: len(sky), :AROUND, :3] = sky.clip(0, 255)
    image[:, AROUND:] = image[:, :WIDTH]
    return image


def view(panorama: Image, yaw: float) -> Image:
    """Return what of the panorama a camera with heading `yaw` sees, uint8 (HEIGHT, WIDTH, 4)."""
    left = round(-yaw * FOCAL - WIDTH / 2) % AROUND
    return panorama[:, left : left + WIDTH]


def _towards_sun(
    lighting: Lighting, bearing: NDArray[np.float64], spread: float
) -> NDArray[np.float64]:
    """Return 1 in the sun's direction, less the further away; bearings are clockwise."""
    sun = -lighting.sun_side * SUN_BEARING
    return np.exp((np.cos(bearing - sun) - 1) / spread**2)


def _gradient(
    lighting: Lighting, elevation: NDArray[np.float64], bearing: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the clear sky (rows, columns, 3): from the horizon's colour up to the zenith's."""
    low = np.exp(-elevation / 0.20)[..., None]
    glow = (_towards_sun(lighting, bearing, 0.8) * np.exp(-elevation / 0.16))[..., None]
    sky = np.array(lighting.zenith) + low * (np.array(lighting.horizon) - np.array(lighting.zenith))
    return np.asarray(sky + glow * (np.array(lighting.glow) - sky))


def _clouds(
    lighting: Lighting,
    elevation: NDArray[np.float64],
    bearing: NDArray[np.float64],
    rng: np.random.Generator,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return how much cloud covers the sky and how shaded it is, both (rows, columns, 1) in 0..1.

    Clouds are noise on a flat layer overhead, seen in perspective: small and dense towards the
    horizon.
    """
    layer = fractal_noise((CLOUD_TILE, CLOUD_TILE), 1.75, rng)
    threshold = np.quantile(layer, 1 - lighting.cover)
    distance = 130.0 / np.tan(np.maximum(elevation, 0.06))
    x = (distance * np.cos(bearing) % CLOUD_TILE).astype(np.float32)
    y = (distance * np.sin(bearing) % CLOUD_TILE).astype(np.float32)
    sampled = cv2.remap(layer, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    above = sampled[np.maximum(np.arange(len(sampled)) - 7, 0)]
    fade = np.clip(elevation / 0.10, 0, 1)
    cover = np.clip((sampled - threshold) * 1.9, 0, 1) * fade
    shade = np.clip(0.45 + (above - threshold) * 0.5 - (sampled - above) * 0.8, 0, 1)
    return cover[..., None].astype(np.float32), shade[..., None].astype(np.float32)


def _draw_skyline(sky: NDArray[np.float64], lighting: Lighting, rng: np.random.Generator) -> None:
    """Draw two ranges of hills, pale with distance, along the horizon."""
    rows = np.arange(len(sky))[:, None]
    for height, strength in ((26, 0.35), (15, 0.6)):
        hills = height + 7 * fractal_noise((1, AROUND), 1.6, rng)
        covered = rows > HORIZON - hills
        sky[covered] += strength * (0.62 * np.array(lighting.haze) - sky[covered])
