"""Textures: painting them in metres, lighting them, and keeping them in several sizes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.light import Colour, Image

PIXELS_PER_METRE = 20
HALVINGS = 3  # how often a texture is halved in height, and in width
BLACK: Colour = (0, 0, 0)
Points = Sequence[tuple[float, float]] | NDArray[np.float64]


def fractal_noise(
    shape: tuple[int, int], roughness: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return noise of zero mean and unit variance whose spectrum falls as frequency^-roughness.

    It is periodic in both directions, so that it tiles.
    """
    spectrum = np.fft.rfft2(rng.standard_normal(shape))
    frequency = np.hypot(
        np.fft.fftfreq(shape[0])[:, None] * shape[0], np.fft.rfftfreq(shape[1]) * shape[1]
    )
    spectrum *= np.maximum(frequency, 1.0) ** -roughness
    spectrum[0, 0] = 0.0
    noise = np.fft.irfft2(spectrum, shape)
    return np.asarray(noise / noise.std(), dtype=np.float32)


def stains(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """Return smooth blotches of zero mean and about unit variance, a metre across."""
    coarse = (shape[0] // PIXELS_PER_METRE + 3, shape[1] // PIXELS_PER_METRE + 3)
    blotches = rng.standard_normal(coarse, dtype=np.float32)
    return cv2.resize(blotches, shape[::-1], interpolation=cv2.INTER_CUBIC).astype(np.float32)


def scale(colour: Colour, factor: float) -> Colour:
    """Return `colour` times `factor`, at most 255."""
    return tuple(min(255.0, c * factor) for c in colour)  # type: ignore[return-value]


@dataclass
class Canvas:
    """A painter's surface of `width` by `height` metres, origin at its lower left corner.

    Attributes:
        albedo: the surface's own colour, uint8 (H, W, 3).
        glow: light that the surface gives off or mirrors, uint8 (H, W, 3).
        cover: 255 where there is a surface, 0 where one sees through, uint8 (H, W).
    """

    width: float
    height: float
    albedo: Image = field(init=False)
    glow: Image = field(init=False)
    cover: Image = field(init=False)

    def __post_init__(self) -> None:
        rows = max(2, round(self.height * PIXELS_PER_METRE))
        columns = max(2, round(self.width * PIXELS_PER_METRE))
        self.albedo = np.zeros((rows, columns, 3), np.uint8)
        self.glow = np.zeros((rows, columns, 3), np.uint8)
        self.cover = np.full((rows, columns), 255, np.uint8)

    def pixels(self, points: Points) -> NDArray[np.int32]:
        """Return pixels (N, 2) of points given in metres."""
        metres = np.asarray(points, dtype=np.float64)
        metres = np.stack([metres[:, 0], self.height - metres[:, 1]], axis=1)
        return np.round(metres * PIXELS_PER_METRE).astype(np.int32)

    def box(self, x0: float, z0: float, x1: float, z1: float) -> tuple[slice, slice]:
        """Return the array rows and columns of a rectangle given in metres."""
        left, right = (max(0, round(x * PIXELS_PER_METRE)) for x in (x0, x1))
        top, bottom = (max(0, round((self.height - z) * PIXELS_PER_METRE)) for z in (z1, z0))
        return slice(top, bottom), slice(left, right)

    def rectangle(
        self, x0: float, z0: float, x1: float, z1: float, colour: Colour, glow: Colour = BLACK
    ) -> None:
        """Paint a rectangle from (x0, z0) to (x1, z1) metres."""
        rows, columns = self.box(x0, z0, x1, z1)
        if rows.start < rows.stop and columns.start < columns.stop:
            corners = (columns.start, rows.start), (columns.stop - 1, rows.stop - 1)
            cv2.rectangle(self.albedo, *corners, colour, cv2.FILLED)
            cv2.rectangle(self.glow, *corners, glow, cv2.FILLED)
            cv2.rectangle(self.cover, *corners, (255,), cv2.FILLED)

    def polygon(self, points: Points, colour: Colour, glow: Colour = BLACK) -> None:
        """Paint a polygon whose corners are given in metres."""
        pixels = self.pixels(points)
        cv2.fillPoly(self.albedo, [pixels], colour)
        cv2.fillPoly(self.glow, [pixels], glow)
        cv2.fillPoly(self.cover, [pixels], (255,))

    def disc(self, x: float, z: float, radius: float, colour: Colour) -> None:
        """Paint a disc around (x, z) metres."""
        angles = np.linspace(0, 2 * np.pi, 20, endpoint=False)
        rim = np.stack([x + radius * np.cos(angles), z + radius * np.sin(angles)], axis=1)
        self.polygon(rim, colour)

    def cut(self, points: Points) -> None:
        """Take the surface away inside a polygon whose corners are given in metres."""
        cv2.fillPoly(self.cover, [self.pixels(points)], (0,))

    def clear(self) -> None:
        """Take the whole surface away."""
        self.cover[:] = 0

    def shade(self, x0: float, z0: float, x1: float, z1: float, factor: float) -> None:
        """Multiply what is painted in a rectangle by `factor`."""
        area = self.box(x0, z0, x1, z1)
        self.albedo[area] = (self.albedo[area] * factor).astype(np.uint8)
        self.glow[area] = (self.glow[area] * factor).astype(np.uint8)

    def bond(self, course: float, length: float, factor: float) -> None:
        """Multiply the joints between stones, `course` by `length` metres, by `factor`."""
        joint = 1.2 / PIXELS_PER_METRE
        z = self.row_heights()
        x = (np.arange(self.albedo.shape[1]) + 0.5) / PIXELS_PER_METRE
        odd = z // course % 2 == 1
        joints = np.zeros(self.cover.shape, bool)
        joints[~odd] = x % length < joint
        joints[odd] = (x + length / 2) % length < joint
        joints[z % course < joint] = True
        self.albedo[joints] = np.clip(self.albedo[joints] * factor, 0, 255).astype(np.uint8)

    def grain(self, noise: NDArray[np.float32], strength: float) -> None:
        """Vary the albedo by `noise` (H, W) of unit variance, times `strength` pixel values."""
        self.albedo = np.clip(self.albedo + strength * noise[..., None], 0, 255).astype(np.uint8)

    def lit(self, light: NDArray[np.float32]) -> Image:
        """Return the surface under `light` of each row, (H, 3) or (1, 3), as uint8 (H, W, 4)."""
        colour = np.clip(self.albedo * light[:, None] + self.glow, 0, 255).astype(np.uint8)
        return cv2.merge([colour, self.cover]).astype(np.uint8, copy=False)

    def row_heights(self) -> NDArray[np.float64]:
        """Return the height in metres of each row's middle (H,)."""
        rows = len(self.albedo)
        return (rows - 0.5 - np.arange(rows)) * self.height / rows


@dataclass(frozen=True)
class Texture:
    """A painted image in several sizes, so that far away it does not sparkle.

    Attributes:
        sizes: uint8 (H, W, 4) at [j][i]: both sides halved j times, then the width i times, for
            a street's walls are seen so obliquely that they shrink in width long before in height.
    """

    sizes: tuple[tuple[Image, ...], ...]

    def fitting(self, columns: float, rows: float) -> Image:
        """Return the smallest size that still has about `columns` x `rows` pixels."""
        height, width = self.sizes[0][0].shape[:2]
        j = _halvings(height / max(rows, 1.0))
        return self.sizes[j][_halvings(width / 2**j / max(columns, 1.0))]


def _halvings(ratio: float) -> int:
    """Return how often a side may be halved that is `ratio` times as long as needed."""
    return min(max(int(math.log2(ratio)), 0), HALVINGS) if ratio > 1 else 0


def make_texture(image: Image) -> Texture:
    """Return the texture of an image, uint8 (H, W, 4)."""

    def halved(image: Image, both: bool) -> Image:
        height, width = image.shape[:2]
        size = (max(1, width // 2), max(1, height // 2) if both else height)
        return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)

    sizes = []
    for _ in range(HALVINGS + 1):
        row = [image]
        for _ in range(HALVINGS):
            row.append(halved(row[-1], both=False))
        sizes.append(tuple(row))
        image = halved(image, both=True)
    return Texture(tuple(sizes))
