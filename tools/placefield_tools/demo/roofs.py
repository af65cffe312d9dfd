"""Roofs and side walls: what of a building rises behind its front."""

import numpy as np

from placefield_tools.demo.light import Colour, Lighting
from placefield_tools.demo.street import Building
from placefield_tools.demo.texture import Canvas, Texture, make_texture, scale
from placefield_tools.demo.walls import paint_pane, paint_wall, paint_window

SLATE: Colour = (92, 84, 80)
TILE: Colour = (64, 78, 136)
MANSARD_HEIGHT = 3.0  # metres
MANSARD_LEAN = 1.3
GABLE_HEIGHT = 3.2
SPIRE_HEIGHT = 8.0
END_WALL_SHINE = 0.82  # a wall along the street's direction gets less light than one across it


def paint_end_wall(building: Building, lighting: Lighting) -> Texture:
    """Return the side wall of `building` with, under a mansard, the roof's outline on top."""
    rng = np.random.default_rng([building.seed, 2])
    depth, eaves = building.depth, building.eaves
    mansard = building.roof == "mansard"
    canvas = Canvas(depth, eaves + (MANSARD_HEIGHT if mansard else 0.0))
    paint_wall(canvas, building, rng)
    if mansard:
        street = depth if building.side == 1 else 0.0
        inner = abs(street - MANSARD_LEAN)
        canvas.cut([(street, eaves), (street, canvas.height), (inner, canvas.height)])
    for middle in np.arange(2.0, depth - 1.5, 4.0):
        for floor in range(building.floors):
            if rng.random() < 0.35:
                bottom = building.ground_height + floor * building.storey_height
                paint_window(canvas, building, middle, bottom, lighting, rng)
    light = lighting.on_facade(lighting.sun_side, canvas.row_heights())
    return make_texture(canvas.lit(END_WALL_SHINE * light))


def paint_mansard(building: Building, lighting: Lighting) -> Texture:
    """Return the steep roof of `building` with its dormer windows, `MANSARD_HEIGHT` high."""
    rng = np.random.default_rng([building.seed, 3])
    canvas = _tiled(building, building.width, MANSARD_HEIGHT)
    colour = _roof_colour(building)
    for middle in np.arange(building.width / building.bays, building.width - 0.9, 3.1):
        canvas.rectangle(middle - 0.75, 0.35, middle + 0.75, 2.3, building.trim)
        tip = [(middle - 0.95, 2.2), (middle + 0.95, 2.2), (middle, 2.8)]
        canvas.polygon(tip, scale(colour, 0.8))
        paint_pane(canvas, middle - 0.5, 0.6, middle + 0.5, 2.1, lighting, rng)
    canvas.rectangle(0, MANSARD_HEIGHT - 0.2, building.width, MANSARD_HEIGHT, scale(colour, 0.6))
    return _lit(canvas, building.side, building.eaves, lighting)


def paint_slope(building: Building, lighting: Lighting) -> Texture:
    """Return the slope of a gabled roof that faces the way the camera comes from."""
    slope = float(np.hypot(GABLE_HEIGHT, building.width / 2))
    canvas = _tiled(building, building.depth, slope)
    return _lit(canvas, lighting.sun_side, building.eaves, lighting)


def paint_spire(building: Building, side: int, lighting: Lighting) -> Texture:
    """Return one face of a spire, a triangle, lit like a façade of `side`."""
    canvas = _tiled(building, building.width, SPIRE_HEIGHT)
    width, top = building.width, SPIRE_HEIGHT
    canvas.cut([(0, 0), (width / 2, top), (0, top)])
    canvas.cut([(width, 0), (width / 2, top), (width, top)])
    return _lit(canvas, side, building.eaves, lighting)


def _roof_colour(building: Building) -> Colour:
    return SLATE if building.seed % 5 < 3 else TILE


def _tiled(building: Building, width: float, height: float) -> Canvas:
    """Return a canvas covered with courses of slate or tiles."""
    rng = np.random.default_rng([building.seed, 4])
    canvas, colour = Canvas(width, height), _roof_colour(building)
    canvas.rectangle(0, 0, width, height, colour)
    canvas.bond(0.32, 0.5, 0.75)
    canvas.grain(rng.standard_normal(canvas.cover.shape, dtype=np.float32), 7)
    return canvas


def _lit(canvas: Canvas, side: int, lift: float, lighting: Lighting) -> Texture:
    return make_texture(canvas.lit(lighting.on_facade(side, canvas.row_heights() + lift)))
