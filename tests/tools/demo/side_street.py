"""The demo street with a side street that turns off to the right, and drives along both."""

from dataclasses import dataclass, replace

import numpy as np

from placefield_tools.demo.light import LIGHTINGS, Image, Light, Lighting, develop
from placefield_tools.demo.rendered_traverse import RATE, SPEED
from placefield_tools.demo.route import STEP, Route
from placefield_tools.demo.scene import Scene, draw_scene, make_scene
from placefield_tools.demo.street import FRONT, Side, Street
from placefield_tools.demo.street_layout import make_street
from placefield_tools.demo.traffic import LANE, make_traffic

JUNCTION = 36
"""The number of the first frame that differs: straight on, or in the turn."""

_SPACING = SPEED / RATE  # metres from frame to frame
_LEAVES = (JUNCTION - 1) * _SPACING  # metres along the street where the turn begins
_TURN = 15.0  # metres of driving in the turn
_MOUTH = _LEAVES + 2 * _TURN / np.pi  # metres along the street to the middle of the side street


@dataclass(frozen=True)
class Junction:
    """A street and its side street in one light; both scenes hold the things of both."""

    lighting: Lighting
    street: Scene
    side_street: Scene

    def drive(self, count: int, seed: int, *, turns: bool) -> list[Image]:
        """Return the frames of a drive that goes straight on or turns off.

        Noise is that of ``seed``, and so is the traffic, which keeps to the street. At dusk the
        camera drives further left, as that of ``placefield demo``.
        """
        offset = -LANE + (0.45 if self.lighting.lamps_on else 0.0)
        traffic, rng = make_traffic([seed], count * _SPACING, SPEED), np.random.default_rng(seed)
        frames = []
        for number in range(count):
            if turns and number >= JUNCTION:
                drawn = draw_scene(self.side_street, number * _SPACING - _LEAVES, offset, [])
            else:
                cars = [car.at(number / RATE) for car in traffic]
                drawn = draw_scene(self.street, number * _SPACING, offset, cars)
            frames.append(develop(drawn, self.lighting, rng))
        return frames


def make_junction(light: Light) -> Junction:
    """Return the junction in a light."""
    lighting, clouds = LIGHTINGS[light], [list(LIGHTINGS).index(light)]
    street, side = make_street(0, 100.0), make_street(1, 50.0)
    side = replace(side, route=_turning_off(street.route, side.route))
    parts = [
        _cleared(street, _MOUTH - FRONT, _MOUTH + FRONT, (-1,)),
        _cleared(side, -np.inf, _TURN, (-1, 1)),
    ]
    scenes = [make_scene(part, lighting, clouds) for part in parts]
    things = tuple(thing for scene in scenes for thing in scene.things)
    footprints = np.concatenate([scene.footprints for scene in scenes])
    sky = scenes[0].panorama
    whole = [replace(scene, things=things, footprints=footprints, panorama=sky) for scene in scenes]
    return Junction(lighting, *whole)


def _turning_off(street: Route, side: Route) -> Route:
    """Return the line of the side street; it begins where the turn does, on that of the street."""
    beyond = np.where(side.arc > _TURN, side.yaw - side.heading(_TURN), 0.0)
    yaw = street.heading(_LEAVES) - np.clip(side.arc / _TURN, 0, 1) * np.pi / 2 + beyond
    x, y = np.cumsum(np.cos(yaw)) * STEP, np.cumsum(np.sin(yaw)) * STEP
    east, north, _ = street.point(_LEAVES)
    x += east - np.interp(0, side.arc, x)
    y += north - np.interp(0, side.arc, y)
    return Route(side.arc, x, y, yaw)


def _cleared(street: Street, start: float, end: float, sides: tuple[Side, ...]) -> Street:
    """Return a street with nothing on these sides between two points along it, in metres."""

    def stays(side: float, first: float, last: float) -> bool:
        return np.sign(side) not in sides or last <= start or first >= end

    return replace(
        street,
        buildings=tuple(one for one in street.buildings if stays(one.side, one.start, one.end)),
        gaps=tuple(one for one in street.gaps if stays(one.side, one.start, one.start + one.width)),
        trees=tuple(one for one in street.trees if stays(one.offset, one.arc, one.arc)),
        lamps=tuple(one for one in street.lamps if stays(one.side, one.arc, one.arc)),
        parked=tuple(one for one in street.parked if stays(one.offset, one.arc, one.arc)),
    )
