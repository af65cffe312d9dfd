"""Buildings in the round: the panels of walls, roofs, awnings, signs and balconies."""

from collections.abc import Iterator

import numpy as np

from placefield_tools.demo.facades import front_height, paint_facade
from placefield_tools.demo.light import Lighting
from placefield_tools.demo.render import Panel
from placefield_tools.demo.roofs import (
    GABLE_HEIGHT,
    MANSARD_HEIGHT,
    MANSARD_LEAN,
    SPIRE_HEIGHT,
    paint_end_wall,
    paint_mansard,
    paint_slope,
    paint_spire,
)
from placefield_tools.demo.route import Route
from placefield_tools.demo.shopfronts import (
    AWNING_DEPTH,
    BLADE_SIZE,
    RAILING_HEIGHT,
    paint_awning,
    paint_blade,
    paint_railing,
)
from placefield_tools.demo.street import Building, Shop, Street
from placefield_tools.demo.texture import Texture

BALCONY = 0.9  # metres that a balcony sticks out
StreetPoint = tuple[float, float, float]  # metres along, to the left of, and above the route


def building_panels(building: Building, street: Street, lighting: Lighting) -> Iterator[Panel]:
    """Yield what can be seen of a building from the street."""
    route, (near, far), front = street.route, _ends(building), building.front
    height = front_height(building)
    facade = paint_facade(building, lighting)
    yield _panel(route, (near, front, 0), (far, front, 0), (near, front, height), facade)
    yield from _roof(building, route, lighting)
    if not _end_wall_hidden(building, street):
        yield _end_wall(building, route, lighting)
    if building.shop:
        yield from _shop(building, building.shop, route, lighting)
    if building.balconies:
        yield from _balconies(building, route, lighting)


def _ends(building: Building) -> tuple[float, float]:
    """Return where the façade's left and right edge stand, as seen from the street."""
    if building.side == 1:
        return building.start, building.end
    return building.end, building.start


def _panel(
    route: Route, left: StreetPoint, right: StreetPoint, above: StreetPoint, texture: Texture
) -> Panel:
    """Return the panel between its lower corners and the upper one above the left."""
    origin, corner, top = (route.point(*point) for point in (left, right, above))
    return Panel(origin, corner - origin, top - origin, texture)


def _end_wall_hidden(building: Building, street: Street) -> bool:
    """Tell whether its side wall is behind the building before it, or it is behind a gap."""
    return building.behind_gap or any(
        other.side == building.side
        and abs(other.end - building.start) < 0.01
        and other.setback <= building.setback
        and other.eaves >= building.eaves
        for other in street.buildings
    )


def _end_wall(building: Building, route: Route, lighting: Lighting) -> Panel:
    """Return the wall that faces the way the camera comes from."""
    back = building.front + building.side * building.depth
    left, right = max(back, building.front), min(back, building.front)
    start = building.start
    texture = paint_end_wall(building, lighting)
    height = building.eaves + (MANSARD_HEIGHT if building.roof == "mansard" else 0.0)
    return _panel(route, (start, left, 0), (start, right, 0), (start, left, height), texture)


def _roof(building: Building, route: Route, lighting: Lighting) -> Iterator[Panel]:
    """Yield the slopes that rise from the eaves."""
    (near, far), front, eaves = _ends(building), building.front, building.eaves
    back = front + building.side * building.depth
    left, right = max(back, front), min(back, front)
    start, middle = building.start, building.start + building.width / 2
    if building.roof == "mansard":
        above = (near, front + building.side * MANSARD_LEAN, eaves + MANSARD_HEIGHT)
        slope = paint_mansard(building, lighting)
        yield _panel(route, (near, front, eaves), (far, front, eaves), above, slope)
    if building.roof == "gable":
        above = (middle, left, eaves + GABLE_HEIGHT)
        slope = paint_slope(building, lighting)
        yield _panel(route, (start, left, eaves), (start, right, eaves), above, slope)
    if building.roof == "spire":
        inward = front + building.side * building.depth / 2
        top = eaves + SPIRE_HEIGHT
        # A spire's texture is a triangle; its tip lies above the middle of the lower edge.
        sides = (
            ((start, left, eaves), (start, right, eaves), (middle, left, top), lighting.sun_side),
            ((near, front, eaves), (far, front, eaves), (near, inward, top), building.side),
        )
        for first, second, above, side in sides:
            yield _panel(route, first, second, above, paint_spire(building, side, lighting))


def _shop(building: Building, shop: Shop, route: Route, lighting: Lighting) -> Iterator[Panel]:
    """Yield the awning and the sign that hang out over the pavement."""
    (near, far), front, outward = _ends(building), building.front, -building.side
    if shop.awning:
        edge, top = front + outward * 0.9 * AWNING_DEPTH, 2.75
        awning = paint_awning(building.width, shop, lighting)
        low = top - 0.45
        yield _panel(route, (near, edge, low), (far, edge, low), (near, front, top), awning)
    if shop.blade:
        arc = building.start + 0.3 * building.width
        width, height = BLADE_SIZE
        wall, tip = front + outward * 0.15, front + outward * (0.15 + width)
        left, right = max(wall, tip), min(wall, tip)
        sign = paint_blade(shop, lighting)
        yield _panel(route, (arc, left, 3.6), (arc, right, 3.6), (arc, left, 3.6 + height), sign)


def _balconies(building: Building, route: Route, lighting: Lighting) -> Iterator[Panel]:
    """Yield one long balcony a floor."""
    near, far = _ends(building)
    margin = 0.5 * np.sign(far - near)
    edge = building.front - building.side * BALCONY
    railing = paint_railing(building.width - 1.0, building.side, lighting)
    for floor in range(building.floors):
        z = building.ground_height + floor * building.storey_height + 0.05
        left, right = (near + margin, edge, z), (far - margin, edge, z)
        yield _panel(route, left, right, (near + margin, edge, z + RAILING_HEIGHT), railing)
