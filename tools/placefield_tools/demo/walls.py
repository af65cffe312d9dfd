"""What walls are made of, and the windows in them."""

import numpy as np

from placefield_tools.demo.light import Colour, Lighting
from placefield_tools.demo.street import Building
from placefield_tools.demo.texture import BLACK, Canvas, scale, stains

ROOM_LIGHTS: tuple[Colour, ...] = (
    (96, 176, 246), (120, 200, 252), (84, 150, 232), (150, 214, 250), (190, 214, 226),
)  # fmt: skip
DARK: Colour = (26, 24, 22)
CURTAIN: Colour = (150, 160, 168)


def paint_wall(canvas: Canvas, building: Building, rng: np.random.Generator) -> None:
    """Cover the canvas with the building's material."""
    canvas.rectangle(0, 0, canvas.width, canvas.height, building.wall)
    if building.material == "brick":
        canvas.grain(rng.standard_normal(canvas.cover.shape, dtype=np.float32), 9)
        canvas.bond(0.25, 0.6, 1.22)
    if building.material == "stone":
        canvas.bond(0.55, 1.2, 0.8)
    canvas.grain(stains(canvas.cover.shape, rng), 5)


def paint_window(
    canvas: Canvas,
    building: Building,
    middle: float,
    bottom: float,
    lighting: Lighting,
    rng: np.random.Generator,
) -> None:
    """Paint a window of the storey above `bottom`, with its frame, sill, bars and shutters."""
    trim, bay = building.trim, building.width / building.bays
    half = min(0.75, 0.3 * bay) if building.shutters else min(0.95, 0.32 * bay)
    low = bottom + (0.25 if building.balconies else 0.75)
    high = bottom + building.storey_height - 0.55
    canvas.rectangle(middle - half - 0.16, low - 0.1, middle + half + 0.16, high + 0.2, trim)
    paint_pane(canvas, middle - half, low, middle + half, high, lighting, rng)
    canvas.rectangle(middle - 0.05, low, middle + 0.05, high, trim)
    transom = low + 0.68 * (high - low)
    canvas.rectangle(middle - half, transom, middle + half, transom + 0.08, trim)
    canvas.rectangle(middle - half - 0.25, low - 0.2, middle + half + 0.25, low - 0.05, trim)
    canvas.shade(middle - half - 0.2, low - 0.42, middle + half + 0.2, low - 0.2, 0.72)
    if building.shutters:
        for x in (middle - half - 0.62, middle + half + 0.1):
            canvas.rectangle(x, low, x + 0.52, high, building.shutters)
            for z in np.arange(low + 0.15, high - 0.1, 0.22):
                canvas.rectangle(x + 0.06, z, x + 0.46, z + 0.08, scale(building.shutters, 0.7))


def paint_pane(
    canvas: Canvas,
    x0: float,
    z0: float,
    x1: float,
    z1: float,
    lighting: Lighting,
    rng: np.random.Generator,
) -> None:
    """Paint glass: a lit room, or a dark one with the sky in its pane, perhaps curtained."""
    lamp, curtain, sky = rng.random(3)
    room = ROOM_LIGHTS[rng.integers(len(ROOM_LIGHTS))]
    lit = lamp < lighting.lit_rooms
    if lit:
        strength = (0.62 + 0.38 * curtain) * (1.0 if lighting.lamps_on else 0.55)
        canvas.rectangle(x0, z0, x1, z1, DARK, scale(room, strength))
        canvas.shade(x0, z0, x1, z0 + 0.35 * (z1 - z0), 0.85)
    else:
        canvas.rectangle(x0, z0, x1, z1, DARK, scale(lighting.pane, 0.35 + 0.35 * sky))
        corner = [(x0, z1), (x1, z1), (x0, z0 + 0.45 * (z1 - z0))]
        canvas.polygon(corner, DARK, scale(lighting.pane, 0.75 + 0.45 * sky))
    if curtain < 0.4:
        glow = scale(room, 0.55) if lit and lighting.lamps_on else BLACK
        width = 0.22 * (x1 - x0)
        canvas.rectangle(x0, z0, x0 + width, z1, CURTAIN, glow)
        canvas.rectangle(x1 - width, z0, x1, z1, CURTAIN, glow)
    canvas.shade(x0, z1 - 0.12, x1, z1, 0.55)
