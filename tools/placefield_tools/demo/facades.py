"""Façades: the fronts of buildings, painted storey by storey."""

import numpy as np

from placefield_tools.demo.light import Lighting
from placefield_tools.demo.roofs import GABLE_HEIGHT
from placefield_tools.demo.shopfronts import paint_door, paint_shop
from placefield_tools.demo.street import Building
from placefield_tools.demo.texture import Canvas, Texture, make_texture, scale
from placefield_tools.demo.walls import paint_pane, paint_wall, paint_window

STEPS = 4  # of a stepped gable


def front_height(building: Building) -> float:
    """Return the height in metres of what is painted as the front of `building`."""
    return building.eaves + (GABLE_HEIGHT if building.roof == "gable" else 0.0)


def paint_facade(building: Building, lighting: Lighting) -> Texture:
    """Return the front of `building`, `front_height(building)` metres high."""
    rng = np.random.default_rng([building.seed, 1])
    canvas = Canvas(building.width, front_height(building))
    paint_wall(canvas, building, rng)
    if building.material == "glass":
        _paint_curtain_wall(canvas, building, lighting, rng)
    else:
        _paint_ornament(canvas, building)
        _paint_storeys(canvas, building, lighting, rng)
    if building.shop:
        paint_shop(canvas, building, building.shop, lighting, rng)
    elif building.material != "glass":
        _paint_home(canvas, building, lighting, rng)
    if building.roof == "gable":
        _cut_gable(canvas, building)
    return make_texture(canvas.lit(lighting.on_facade(building.side, canvas.row_heights())))


def _middles(building: Building) -> list[float]:
    """Return where each bay of windows has its middle, in metres."""
    return [(bay + 0.5) * building.width / building.bays for bay in range(building.bays)]


def _paint_storeys(
    canvas: Canvas, building: Building, lighting: Lighting, rng: np.random.Generator
) -> None:
    """Paint the windows above the ground floor."""
    for floor in range(building.floors):
        bottom = building.ground_height + floor * building.storey_height
        for middle in _middles(building):
            paint_window(canvas, building, middle, bottom, lighting, rng)


def _paint_ornament(canvas: Canvas, building: Building) -> None:
    """Paint plinth, string courses, quoins and cornice."""
    width, trim, first, eaves = (
        building.width,
        building.trim,
        building.ground_height,
        building.eaves,
    )
    canvas.rectangle(0, 0, width, 0.5, scale(building.wall, 0.62))
    canvas.rectangle(0, first - 0.35, width, first - 0.1, trim)
    canvas.shade(0, first - 0.5, width, first - 0.35, 0.75)
    if building.seed % 3 == 0:
        for floor in range(1, building.floors):
            z = first + floor * building.storey_height
            canvas.rectangle(0, z - 0.1, width, z + 0.08, trim)
    if building.seed % 2 == 0 and building.material == "brick":
        for i, z in enumerate(np.arange(0.5, eaves - 0.6, 0.45)):
            reach = 0.55 if i % 2 else 0.35
            canvas.rectangle(0, z, reach, z + 0.38, trim)
            canvas.rectangle(width - reach, z, width, z + 0.38, trim)
    canvas.shade(0, eaves - 0.95, width, eaves - 0.5, 0.68)
    canvas.rectangle(0, eaves - 0.5, width, eaves - 0.1, trim)
    canvas.rectangle(0, eaves - 0.1, width, eaves, scale(trim, 0.7))


def _paint_curtain_wall(
    canvas: Canvas, building: Building, lighting: Lighting, rng: np.random.Generator
) -> None:
    """Paint a wall of glass: panes between mullions, with a solid band at each floor."""
    columns = 2 * building.bays
    width, first = building.width / columns, building.ground_height
    for left in np.arange(columns) * width:
        x0, x1 = left + 0.06, left + width - 0.06
        paint_pane(canvas, x0, 0.2, x1, first, lighting, rng)
        for floor in range(building.floors):
            bottom = first + floor * building.storey_height
            top = bottom + building.storey_height
            paint_pane(canvas, x0, bottom + 0.7, x1, top, lighting, rng)


def _paint_home(
    canvas: Canvas, building: Building, lighting: Lighting, rng: np.random.Generator
) -> None:
    """Paint a ground floor to live in: a door, and windows in the other bays."""
    door = int(rng.integers(building.bays))
    for bay, middle in enumerate(_middles(building)):
        if bay == door:
            paint_door(canvas, building, middle, lighting, rng)
        else:
            paint_window(canvas, building, middle, 0.35, lighting, rng)


def _cut_gable(canvas: Canvas, building: Building) -> None:
    """Cut the top of the canvas to a gable, stepped or plain, and edge it."""
    width, eaves, top, trim = building.width, building.eaves, canvas.height, building.trim
    if building.seed % 2:
        rise, run = (top - eaves) / STEPS, 0.42 * width / STEPS
        for step in range(STEPS):
            z, x = eaves + step * rise, (step + 0.7) * run
            canvas.rectangle(x, z + rise - 0.15, width - x, z + rise, trim)
            canvas.cut([(0, z), (x, z), (x, top), (0, top)])
            canvas.cut([(width, z), (width - x, z), (width - x, top), (width, top)])
    else:
        upper = [(0.0, eaves), (width / 2, top), (width, eaves)]
        lower = [(x, z - 0.4) for x, z in reversed(upper)]
        canvas.polygon(upper + lower, trim)
        canvas.cut([(0, eaves), (width / 2, top), (0, top)])
        canvas.cut([(width, eaves), (width / 2, top), (width, top)])
    canvas.disc(width / 2, eaves + 1.0, 0.7, trim)
    canvas.disc(width / 2, eaves + 1.0, 0.5, (40, 38, 36))
