"""Cars: a few models made of flat faces."""

from dataclasses import dataclass

import numpy as np

from placefield_tools.demo.light import Colour, Lighting
from placefield_tools.demo.render import Mesh
from placefield_tools.demo.route import Route
from placefield_tools.demo.street import Car
from placefield_tools.demo.texture import scale

Point = tuple[float, float, float]
Face = tuple[list[Point], Colour]  # corners, clockwise as seen from outside
TYRE: Colour = (34, 32, 30)
HUB: Colour = (150, 150, 150)
TRIM: Colour = (46, 46, 46)
PLATE: Colour = (210, 220, 224)
TAIL_LIGHT: Colour = (40, 30, 190)
HEADLIGHT: Colour = (235, 250, 255)
WHEEL = 0.34  # metres, the radius


@dataclass(frozen=True)
class Model:
    """A car's outline in metres; x runs from rear to front, the origin is below its middle."""

    length: float
    width: float
    bonnet: float  # height of bonnet and boot
    roof: float  # height of the roof
    cabin: tuple[float, float]  # x of the cabin's rear and front at the height of the bonnet
    top: tuple[float, float]  # x of the roof's rear and front


MODELS = (
    Model(4.1, 1.78, 0.92, 1.48, (-1.9, 1.1), (-1.5, 0.2)),
    Model(4.6, 1.82, 0.90, 1.44, (-1.7, 1.2), (-0.9, 0.3)),
    Model(4.7, 1.90, 1.05, 1.90, (-2.2, 1.7), (-2.1, 1.0)),
)


def car_mesh(car: Car, route: Route, lighting: Lighting, *, moving: bool) -> Mesh:
    """Return the faces of a car in the world; a moving one has its lights on where lamps burn."""
    model = MODELS[car.model]
    burning = moving and lighting.lamps_on
    faces = _shadow(model, lighting) + _flanks(model, car.paint, lighting)
    faces += _rear(model, car.paint, lighting, burning) + _nose(model, car.paint, lighting, burning)
    lights, glows = np.zeros((0, 3)), np.zeros((0, 3))
    if burning:
        x, y = model.length / 2 + 0.05, model.width / 2 - 0.28
        lights = np.array([[x, y, 0.68], [x, -y, 0.68], [-x, y, 0.8], [-x, -y, 0.8]])
        glows = np.array([[200, 235, 255], [200, 235, 255], [20, 16, 150], [20, 16, 150]])
    yaw = float(route.heading(car.arc)) + (0.0 if car.direction == 1 else np.pi)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    world = route.point(car.arc, car.offset)
    points = np.concatenate([np.array(corners) for corners, _ in faces])
    return Mesh(
        points @ turn.T + world,
        np.cumsum([0, *(len(corners) for corners, _ in faces)]),
        np.array([colour for _, colour in faces], dtype=np.float64),
        lights @ turn.T + world,
        glows,
    )


def _lit(colour: Colour, lighting: Lighting, shine: float) -> Colour:
    """Return a surface's colour in the street's light; `shine` is how well it faces the sky."""
    blue, green, red = (c * light for c, light in zip(colour, lighting.in_street, strict=True))
    return scale((blue, green, red), shine)


def _glass(lighting: Lighting) -> Colour:
    return scale(lighting.pane, 0.55)


def _shadow(model: Model, lighting: Lighting) -> list[Face]:
    x, y = model.length / 2 + 0.1, model.width / 2 + 0.15
    corners = [(-x, -y, 0.01), (-x, y, 0.01), (x, y, 0.01), (x, -y, 0.01)]
    return [(corners, scale((80, 80, 82), lighting.ambient[1]))]


def _flanks(model: Model, paint: Colour, lighting: Lighting) -> list[Face]:
    """Return both sides: body, cabin, two windows and two wheels each."""
    half, belt, roof = model.length / 2, model.bonnet, model.roof
    (rear, front), (top_rear, top_front) = model.cabin, model.top
    sill, lift, pillar = belt + 0.05, roof - 0.09, (top_rear + top_front) / 2
    glass = _glass(lighting)
    body = [(-half, 0.3), (-half + 0.05, belt - 0.05), (rear, belt), (front, belt),
            (half - 0.06, belt - 0.1), (half, 0.3)]  # fmt: skip
    cabin = [(rear, belt), (top_rear, roof), (top_front, roof), (front, belt)]
    window_rear = [(rear + 0.25, sill), (top_rear + 0.1, lift), (pillar - 0.05, lift),
                   (pillar - 0.05, sill)]  # fmt: skip
    window_front = [(pillar + 0.05, sill), (pillar + 0.05, lift), (top_front - 0.02, lift),
                    (front - 0.22, sill)]  # fmt: skip
    outlines = [
        (body, _lit(paint, lighting, 0.82)),
        (cabin, _lit(paint, lighting, 0.8)),
        (window_rear, glass),
        (window_front, glass),
    ]
    angles = -np.linspace(0, 2 * np.pi, 12, endpoint=False)
    for x in (-half + 0.8, half - 0.85):
        for radius, colour in ((WHEEL, TYRE), (0.55 * WHEEL, HUB)):
            ring = [(x + radius * np.cos(a), WHEEL + radius * np.sin(a)) for a in angles]
            outlines.append((ring, _lit(colour, lighting, 0.85)))

    def inset(z: float) -> float:
        return 0.2 * max(0.0, z - belt) / (roof - belt)

    faces: list[Face] = []
    for outline, colour in outlines:
        right = [(x, -model.width / 2 + inset(z), z) for x, z in outline]
        faces.append((right, colour))
        faces.append(([(x, -y, z) for x, y, z in right[::-1]], colour))
    return faces


def _across(x0: float, z0: float, x1: float, z1: float, half: float, y: float = 0.0) -> list[Point]:
    """Return a face across the car, from (x0, z0) up to (x1, z1), that looks to the rear."""
    return [(x0, y + half, z0), (x1, y + half, z1), (x1, y - half, z1), (x0, y - half, z0)]


def _rear(model: Model, paint: Colour, lighting: Lighting, burning: bool) -> list[Face]:
    """Return what looks backwards or up, from the bumper to the front of the roof."""
    x, side, belt, roof = -model.length / 2, model.width / 2, model.bonnet, model.roof
    inner, rear, top = side - 0.2, model.cabin[0], model.top[0]
    tail = scale(TAIL_LIGHT, 1.3 if burning else 0.3 + 0.6 * lighting.ambient[1])
    return [
        (_across(x, 0.3, x + 0.05, belt - 0.05, side), _lit(paint, lighting, 0.72)),
        (_across(x + 0.05, belt - 0.05, rear, belt, side), _lit(paint, lighting, 1.05)),
        (_across(rear, belt, top, roof, inner + 0.08), _lit(paint, lighting, 0.9)),
        (_across(rear + 0.06, belt + 0.08, top - 0.04, roof - 0.1, inner - 0.02), _glass(lighting)),
        (_across(top, roof, model.top[1], roof, inner), _lit(paint, lighting, 1.12)),
        (_across(x - 0.02, 0.28, x - 0.02, 0.44, side), _lit(TRIM, lighting, 1.0)),
        (_across(x - 0.03, 0.5, x - 0.03, 0.62, 0.26), _lit(PLATE, lighting, 1.0)),
        (_across(x - 0.03, 0.64, x - 0.02, 0.82, 0.17, side - 0.2), tail),
        (_across(x - 0.03, 0.64, x - 0.02, 0.82, 0.17, 0.2 - side), tail),
    ]


def _nose(model: Model, paint: Colour, lighting: Lighting, burning: bool) -> list[Face]:
    """Return what looks forwards, from the bumper to the windscreen."""
    x, side, belt, roof = model.length / 2, model.width / 2, model.bonnet, model.roof
    inner, front, top = side - 0.2, model.cabin[1], model.top[1]
    lamp = HEADLIGHT if burning else _lit((190, 196, 200), lighting, 0.9)
    faces = [
        (_across(x, 0.3, x - 0.06, belt - 0.1, side), _lit(paint, lighting, 0.76)),
        (_across(x - 0.06, belt - 0.1, front, belt, side), _lit(paint, lighting, 1.08)),
        (_across(front, belt, top, roof, inner + 0.08), _lit(paint, lighting, 0.9)),
        (_across(front - 0.08, belt + 0.06, top + 0.03, roof - 0.07, inner), _glass(lighting)),
        (_across(x + 0.02, 0.28, x + 0.02, 0.44, side), _lit(TRIM, lighting, 1.0)),
        (_across(x + 0.02, 0.5, x + 0.02, 0.64, 0.45), _lit(TRIM, lighting, 0.9)),
        (_across(x + 0.02, 0.58, x - 0.02, 0.74, 0.2, side - 0.26), lamp),
        (_across(x + 0.02, 0.58, x - 0.02, 0.74, 0.2, 0.26 - side), lamp),
    ]
    return [(corners[::-1], colour) for corners, colour in faces]
