"""What a building shows at street level, and what sticks out of it: doors, shops, awnings."""

import cv2
import numpy as np

from placefield_tools.demo.light import Colour, Lighting
from placefield_tools.demo.street import Building, Shop
from placefield_tools.demo.texture import (
    BLACK,
    PIXELS_PER_METRE,
    Canvas,
    Texture,
    make_texture,
    scale,
)

AWNING_DEPTH = 1.4  # metres from wall to edge
BLADE_SIZE = (0.8, 1.8)  # metres, width and height
RAILING_HEIGHT = 1.25
DOORS: tuple[Colour, ...] = ((48, 60, 96), (44, 78, 44), (104, 58, 34), (40, 40, 120), (52, 50, 50))
PALE: Colour = (230, 232, 232)
SHOP_LIGHT: Colour = (150, 214, 250)


def paint_door(
    canvas: Canvas, building: Building, middle: float, lighting: Lighting, rng: np.random.Generator
) -> None:
    """Paint a front door with its surround and fanlight."""
    colour = DOORS[rng.integers(len(DOORS))]
    canvas.rectangle(middle - 0.85, 0, middle + 0.85, 3.0, building.trim)
    canvas.rectangle(middle - 0.62, 0.1, middle + 0.62, 2.2, colour)
    for x in (middle - 0.5, middle + 0.06):
        for low, high in ((0.35, 1.0), (1.15, 2.0)):
            canvas.rectangle(x, low, x + 0.44, high, scale(colour, 0.75))
    fanlight = scale(SHOP_LIGHT, 0.8) if lighting.lamps_on else scale(lighting.pane, 0.5)
    canvas.rectangle(middle - 0.62, 2.32, middle + 0.62, 2.8, (24, 24, 24), fanlight)


def paint_shop(
    canvas: Canvas, building: Building, shop: Shop, lighting: Lighting, rng: np.random.Generator
) -> None:
    """Paint a shop over the whole ground floor: window, goods, door and the name above."""
    width, top = building.width, building.ground_height - 0.3
    canvas.rectangle(0.15, 0, width - 0.15, top, scale(shop.colour, 0.55))
    panes = max(2, round(width / 2.6))
    step = (width - 0.7) / panes
    door = int(rng.integers(panes))
    for pane in range(panes):
        x0, x1 = 0.35 + pane * step + 0.08, 0.35 + (pane + 1) * step - 0.08
        _paint_shop_window(canvas, x0, 0.12 if pane == door else 0.55, x1, 2.55, lighting, rng)
    sign_glow = scale(shop.colour, 0.55) if lighting.lamps_on else BLACK
    canvas.rectangle(0.15, 2.65, width - 0.15, top, shop.colour, sign_glow)
    _write(canvas, shop.name, width / 2, (2.65 + top) / 2, 0.62 * (top - 2.65), lighting)


def paint_awning(width: float, shop: Shop, lighting: Lighting) -> Texture:
    """Return a striped awning `width` metres wide and `AWNING_DEPTH` deep."""
    canvas = Canvas(width, AWNING_DEPTH)
    for i, x in enumerate(np.arange(0, width, 0.5)):
        colour = shop.colour if i % 2 else (222, 228, 232)
        canvas.rectangle(x, 0, x + 0.5, AWNING_DEPTH, colour)
    canvas.shade(0, 0, width, 0.25, 0.8)
    return make_texture(canvas.lit(lighting.on_facade(-lighting.sun_side, np.array([3.0]))))


def paint_blade(shop: Shop, lighting: Lighting) -> Texture:
    """Return a sign of `BLADE_SIZE` that hangs out over the pavement."""
    width, height = BLADE_SIZE
    canvas = Canvas(width, height)
    lamp = 0.75 if lighting.lamps_on else 0.0
    canvas.rectangle(0, 0, width, height, PALE, scale(PALE, lamp))
    canvas.rectangle(0.06, 0.06, width - 0.06, height - 0.06, shop.colour, scale(shop.colour, lamp))
    for i, letter in enumerate(shop.name[:4]):
        _write(canvas, letter, width / 2, 1.5 - 0.4 * i, 0.26, lighting)
    return make_texture(canvas.lit(lighting.on_facade(lighting.sun_side, np.array([4.0]))))


def paint_railing(width: float, side: int, lighting: Lighting) -> Texture:
    """Return a balcony's slab and iron railing, `width` metres wide."""
    canvas = Canvas(width, RAILING_HEIGHT)
    canvas.clear()
    for x in np.arange(0.0, width, 0.22):
        canvas.rectangle(x, 0.2, x + 0.09, 1.2, (44, 40, 38))
    canvas.rectangle(0, 1.12, width, RAILING_HEIGHT, (40, 36, 34))
    canvas.rectangle(0, 0, width, 0.22, (178, 184, 186))
    return make_texture(canvas.lit(lighting.on_facade(side, canvas.row_heights() + 6.0)))


def _paint_shop_window(
    canvas: Canvas,
    x0: float,
    z0: float,
    x1: float,
    z1: float,
    lighting: Lighting,
    rng: np.random.Generator,
) -> None:
    """Paint a shop window: light behind it, goods in front of that, sky in the glass by day."""
    strength = 0.98 if lighting.lamps_on else 0.42
    canvas.rectangle(x0, z0, x1, z1, (50, 54, 58), scale(SHOP_LIGHT, strength))
    canvas.shade(x0, z1 - 0.5, x1, z1, 0.8)
    for x in np.arange(x0 + 0.1, x1 - 0.35, 0.45):
        height, colour = rng.uniform(0.3, 1.1), tuple(rng.uniform(20, 190, 3))
        canvas.rectangle(x, z0, x + 0.34, z0 + height, colour, scale(colour, 0.5 * strength))
    if not lighting.lamps_on:
        mirrored = [(x0, z1), (x0 + 0.55 * (x1 - x0), z1), (x0, z0 + 0.3)]
        canvas.polygon(mirrored, (90, 90, 90), scale(lighting.pane, 0.8))


def _write(
    canvas: Canvas, text: str, x: float, z: float, height: float, lighting: Lighting
) -> None:
    """Write `text` in pale letters of `height` metres, centred on (x, z)."""
    font = cv2.FONT_HERSHEY_DUPLEX
    (_, unit), _ = cv2.getTextSize("A", font, 1.0, 1)
    size = height * PIXELS_PER_METRE / unit
    (width, _), _ = cv2.getTextSize(text, font, size, 1)
    corner = (canvas.pixels([(x, z - height / 2)])[0] - (width // 2, 0)).tolist()
    glow = PALE if lighting.lamps_on else BLACK
    for surface, colour in ((canvas.albedo, PALE), (canvas.glow, glow)):
        cv2.putText(surface, text, corner, font, size, colour, 1, cv2.LINE_AA)
