"""A street made ready to be drawn: everything painted and in its place."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.buildings import building_panels
from placefield_tools.demo.cars import car_mesh
from placefield_tools.demo.ground import Ground, draw_ground, paint_ground
from placefield_tools.demo.lamps import LampPost, draw_lamp_post, make_lamp_post
from placefield_tools.demo.light import Image, Lighting
from placefield_tools.demo.pinhole_camera import EYE, NEAR, PinholeCamera
from placefield_tools.demo.render import (
    Billboard,
    Mesh,
    Panel,
    View,
    draw_billboard,
    draw_mesh,
    draw_panel,
)
from placefield_tools.demo.sky import paint_panorama, view
from placefield_tools.demo.street import VISIBLE_RANGE, Car, Street
from placefield_tools.demo.trees import hedges, trees

Thing = Panel | Mesh | Billboard | LampPost


@dataclass(frozen=True)
class Scene:
    """What one traverse sees of a street, apart from the traffic.

    Attributes:
        street: what the scene was made from.
        lighting: the light it was painted in.
        things: what stands along the street.
        footprints: four ground points around each thing, float64 (things, 4, 2).
        ground: the street's surface.
        panorama: the sky all around.
    """

    street: Street
    lighting: Lighting
    things: tuple[Thing, ...]
    footprints: NDArray[np.float64]
    ground: Ground
    panorama: Image


def make_scene(street: Street, lighting: Lighting, cloud_seed: list[int]) -> Scene:
    """Return the scene of `street` under `lighting`, with the clouds of `cloud_seed`."""
    things: list[Thing] = []
    for building in street.buildings:
        things.extend(building_panels(building, street, lighting))
    things.extend(hedges(street, lighting))
    things.extend(trees(street, lighting))
    things.extend(make_lamp_post(lamp, street.route) for lamp in street.lamps)
    things.extend(car_mesh(car, street.route, lighting, moving=False) for car in street.parked)
    return Scene(
        street,
        lighting,
        tuple(things),
        np.stack([_footprint(thing) for thing in things]),
        paint_ground(street, lighting),
        paint_panorama(lighting, street.seed, cloud_seed),
    )


def draw_scene(scene: Scene, arc: float, offset: float, traffic: list[Car]) -> Image:
    """Return what a camera at `arc`, `offset` of the route sees, uint8 (HEIGHT, WIDTH, 3).

    Things are drawn from far to near, panels by their farthest point and the others by their
    nearest: so what stands before a façade comes after it, wherever along it that is, and a car
    comes after the trees and lamps on the pavement behind it.
    """
    route = scene.street.route
    camera = PinholeCamera(route.point(arc, offset, EYE), float(route.heading(arc)))
    sky = view(scene.panorama, camera.yaw)
    drawn = View(sky.copy(), sky, camera)
    draw_ground(drawn.image, scene.ground, route, camera, arc)
    cars = [
        car_mesh(car, route, scene.lighting, moving=True)
        for car in traffic
        if arc < car.arc < arc + VISIBLE_RANGE
    ]
    things = [*scene.things, *cars]
    footprints = np.concatenate([scene.footprints, *(_footprint(car)[None] for car in cars)])
    relative = footprints - camera.position[:2]
    depth = (relative @ camera.forward[:2]).max(axis=1)
    distances = np.linalg.norm(relative, axis=2)
    is_panel = [isinstance(thing, Panel) for thing in things]
    distance = np.where(is_panel, distances.max(axis=1), distances.min(axis=1))
    for index in np.argsort(-distance, kind="stable"):
        if depth[index] > NEAR and distance[index] < VISIBLE_RANGE:
            _draw(drawn, things[index], scene.lighting)
    return cv2.cvtColor(drawn.image, cv2.COLOR_BGRA2BGR).astype(np.uint8, copy=False)


def _draw(drawn: View, thing: Thing, lighting: Lighting) -> None:
    if isinstance(thing, Panel):
        draw_panel(drawn, thing)
    elif isinstance(thing, Mesh):
        draw_mesh(drawn, thing)
    elif isinstance(thing, Billboard):
        draw_billboard(drawn, thing)
    else:
        draw_lamp_post(drawn, thing, lighting)


def _footprint(thing: Thing) -> NDArray[np.float64]:
    """Return four ground points (4, 2) around a thing."""
    if isinstance(thing, Panel):
        return thing.corners[:, :2]
    if isinstance(thing, Mesh):
        return thing.points[:4, :2]
    return np.repeat(thing.foot[None, :2], 4, axis=0)
