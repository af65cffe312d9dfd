"""The ground: the street's surface under a light, and as a camera sees it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.light import Image, Lighting
from placefield_tools.demo.pinhole_camera import (
    CENTRE,
    EYE,
    FOCAL,
    HEIGHT,
    HORIZON,
    WIDTH,
    PinholeCamera,
)
from placefield_tools.demo.route import LEAD, Route
from placefield_tools.demo.street import VISIBLE_RANGE, Building, Street
from placefield_tools.demo.surface import (
    ACROSS,
    ALONG,
    HALF,
    OFFSETS,
    paint_surface,
    pixel,
    rows_between,
)

LEVELS = 6
BELOW_LAMP = 4.5  # brightness of the ground, as a factor on lamplight
BELOW_WINDOW = 2.2
SHADOW_REACH = 0.62  # metres that a shadow falls across the street, per metre of height
SHADOW_LEAN = -0.3  # and along it


@dataclass(frozen=True)
class Ground:
    """The street's surface from above, lit.

    Attributes:
        levels: uint8 (rows, columns, 4), each with half as many rows as the one before: far away,
            where the ground is seen at a flat angle, many rows fall into one pixel.
    """

    levels: tuple[Image, ...]


def paint_ground(street: Street, lighting: Lighting) -> Ground:
    """Return the surface of `street` under `lighting`, with shadows or pools of lamplight."""
    surface = paint_surface(street)
    light = np.full(surface.shape, lighting.ambient, np.float32)
    if lighting.lamps_on:
        light += _lamplight(street, len(surface))[..., None] * np.array(lighting.lamp, np.float32)
    else:
        sunshine = _sunshine(street, lighting, len(surface))
        light += sunshine[..., None] * np.array(lighting.sun, np.float32)
    surface *= light
    colour = np.clip(surface, 0, 255, out=surface).astype(np.uint8)
    levels = [cv2.cvtColor(colour, cv2.COLOR_BGR2BGRA).astype(np.uint8, copy=False)]
    while len(levels) < LEVELS:
        rows, columns = levels[-1].shape[:2]
        halved = cv2.resize(levels[-1], (columns, rows // 2), interpolation=cv2.INTER_AREA)
        levels.append(halved.astype(np.uint8, copy=False))
    return Ground(tuple(levels))


def draw_ground(
    image: Image, ground: Ground, route: Route, camera: PinholeCamera, arc: float
) -> None:
    """Draw the ground below the horizon of `image` as `camera`, at `arc` of the route, sees it.

    What lies beyond the painted width repeats its edge, so that side streets lead on.
    """
    rows = np.arange(int(HORIZON) + 2, HEIGHT)
    depth = np.asarray(FOCAL * EYE / (rows - HORIZON), dtype=np.float64)
    along, offset = _street_coordinates(route, camera, arc, depth)
    u = ((HALF - offset) * ACROSS).astype(np.float32)
    v = ((along + LEAD) * ALONG).astype(np.float32)
    rows_per_pixel = ALONG * depth**2 / (FOCAL * EYE)
    level = np.log2(rows_per_pixel).clip(0, LEVELS - 1).astype(int)
    for k in range(LEVELS):
        (band,) = np.nonzero(level == k)
        v_band = v[band] / 2**k
        first, last = max(0, int(v_band.min()) - 2), int(v_band.max()) + 3
        image[rows[band]] = cv2.remap(
            ground.levels[k][first:last],
            u[band],
            v_band - first,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )


def _street_coordinates(
    route: Route, camera: PinholeCamera, arc: float, depth: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return metres along the route and left of it, (rows, WIDTH) each, of the ground at `depth`.

    Each point is referred to the centre line's tangent at the same depth, which is close enough
    where a street bends gently.
    """
    arcs = np.arange(arc, arc + 1.4 * VISIBLE_RANGE)
    line = route.point(arcs) - camera.position
    ahead, aside = line @ camera.forward, line @ camera.right
    along = np.interp(depth, ahead, arcs)[:, None]
    turn = route.heading(along) - camera.yaw
    right = np.outer(depth, np.arange(WIDTH) - CENTRE) / FOCAL
    from_line = right - np.interp(depth, ahead, aside)[:, None]
    return along - from_line * np.sin(turn), -from_line * np.cos(turn)


def _sunshine(street: Street, lighting: Lighting, rows: int) -> NDArray[np.float32]:
    """Return how much of the sun reaches the ground (rows, columns), 0 in full shadow."""
    mask = np.full((rows, len(OFFSETS)), 255, np.uint8)
    for building in street.buildings:
        if building.side == lighting.sun_side:
            corners = [pixel(*corner) for corner in _shadow(building)]
            cv2.fillPoly(mask, [np.array(corners, np.int32)], (0,))
    rng = np.random.default_rng([street.seed, 21])
    blotch = int(0.55 * ACROSS), int(0.55 * ALONG)
    for tree in street.trees:
        shift = np.array([-1.6, -2.6 * lighting.sun_side])
        centre = np.array([tree.arc, tree.offset]) + shift
        for arc, offset in rng.normal(centre, 1.0, (26, 2)):
            cv2.ellipse(mask, pixel(arc, offset), blotch, 0, 0, 360, (0,), cv2.FILLED)
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), 1.6) / 255.0, dtype=np.float32)


def _shadow(building: Building) -> list[tuple[float, float]]:
    """Return the corners (arc, offset) of what a building covers and shades."""
    start, end, front, side = building.start, building.end, building.front, building.side
    lean = SHADOW_LEAN * building.eaves
    tip = front - side * SHADOW_REACH * building.eaves
    back = front + side * building.depth
    return [
        (start, back), (start, front), (start + lean, tip), (end + lean, tip), (end, front),
        (end, back),
    ]  # fmt: skip


def _lamplight(street: Street, rows: int) -> NDArray[np.float32]:
    """Return the light of lamps and shop windows on the ground (rows, columns)."""
    light = np.zeros((rows, len(OFFSETS)), np.float32)
    arcs = np.arange(rows) / ALONG - LEAD
    for lamp in street.lamps:
        near = rows_between(lamp.arc - 14, lamp.arc + 14)
        along = np.exp(-(((arcs[near] - lamp.arc) / 5.0) ** 2))
        light[near] += BELOW_LAMP * np.outer(
            along, np.exp(-(((OFFSETS - 4.2 * lamp.side) / 3.2) ** 2))
        )
    for building in street.buildings:
        if building.shop:
            before_window = BELOW_WINDOW * np.exp(-abs(OFFSETS - building.front) / 2.2)
            light[rows_between(building.start, building.end)] += before_window
    return light
