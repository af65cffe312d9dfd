import numpy as np
import pytest

from placefield_tools.demo.cars import MODELS, car_mesh
from placefield_tools.demo.light import LIGHTINGS
from placefield_tools.demo.pinhole_camera import (
    CENTRE,
    FOCAL,
    HEIGHT,
    HORIZON,
    NEAR,
    WIDTH,
    PinholeCamera,
)
from placefield_tools.demo.render import Panel, View, draw_mesh, draw_panel
from placefield_tools.demo.route import make_route
from placefield_tools.demo.street import Car
from placefield_tools.demo.texture import make_texture

CAMERA = PinholeCamera(np.array([3.0, -2.0, 1.6]), 0.4)


def rays() -> np.ndarray:
    """The direction (HEIGHT, WIDTH, 3) in which each pixel looks, one metre deep."""
    right = (np.arange(WIDTH) + 0.5 - CENTRE) / FOCAL
    up = (HORIZON - np.arange(HEIGHT) - 0.5) / FOCAL
    forward = np.array([np.cos(CAMERA.yaw), np.sin(CAMERA.yaw), 0])
    sideways = np.array([np.sin(CAMERA.yaw), -np.cos(CAMERA.yaw), 0])
    return forward + right[None, :, None] * sideways + up[:, None, None] * np.array([0.0, 0.0, 1.0])


def cast(panel: Panel) -> np.ndarray:
    """Tell for every pixel whether its ray meets the panel beyond the near plane."""
    system = np.stack([panel.along, panel.up], axis=1)
    normal = np.cross(panel.along, panel.up)
    direction = rays()
    depth = ((panel.origin - CAMERA.position) @ normal) / (direction @ normal)
    hit = CAMERA.position + depth[..., None] * direction - panel.origin
    a, b = np.moveaxis(hit @ np.linalg.pinv(system).T, -1, 0)
    return (depth > NEAR) & (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1)


def drawn(panel: Panel) -> np.ndarray:
    black = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    view = View(black.copy(), black, CAMERA)
    draw_panel(view, panel)
    return view.image[..., 2] > 50


def panel(start: float, end: float, left: float, lean: float = 0.0) -> Panel:
    """A red wall `left` of the camera, from `start` to `end` metres ahead of it, 6 m high."""
    texture = make_texture(np.full((64, 200, 4), (0, 0, 255, 255), np.uint8))
    origin = CAMERA.position + start * CAMERA.forward - left * CAMERA.right
    origin[2] = 0.0
    up = np.array([0.0, 0.0, 6.0]) - lean * CAMERA.right
    return Panel(origin, (end - start) * CAMERA.forward, up, texture)


@pytest.mark.parametrize(
    "wall",
    [
        panel(12, 25, left=7),
        panel(12, 25, left=-6, lean=2),
        panel(25, 8, left=5),
        panel(-20, 30, left=7),
        panel(18, -9, left=-4),
    ],
    ids=["left", "leaning", "far end first", "begins behind", "ends behind"],
)
def test_a_panel_covers_the_pixels_whose_rays_meet_it(wall):
    expected, found = cast(wall), drawn(wall)
    assert expected.sum() > 2000
    assert (expected & found).sum() / (expected | found).sum() > 0.97


def test_a_panel_behind_the_camera_leaves_no_trace():
    assert not drawn(panel(-30, -2, left=7)).any()


@pytest.mark.parametrize("model", range(len(MODELS)))
def test_every_face_of_a_car_is_convex_and_clockwise_from_outside(model):
    car = Car(20.0, -1.65, 1, model, (200, 40, 40))
    mesh = car_mesh(car, make_route(0, 50.0), LIGHTINGS["day"], moving=False)
    middle = mesh.points[:4].mean(axis=0) + np.array([0, 0, 0.6])
    for first, last in zip(mesh.starts[1:-1], mesh.starts[2:], strict=True):
        corners = mesh.points[first:last]
        edges = np.roll(corners, -1, axis=0) - corners
        outward = np.cross(np.roll(edges, -1, axis=0), edges)
        assert (outward @ (corners.mean(axis=0) - middle) > 0).all()


def test_a_car_beside_the_camera_is_cut_off_where_it_leaves_the_view():
    route = make_route(0, 50.0)
    camera = PinholeCamera(route.point(20.0, -1.65, 1.6), float(route.heading(20.0)))
    image = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    car = Car(21.5, -4.35, 1, 0, (200, 40, 40))
    draw_mesh(
        View(image, image.copy(), camera), car_mesh(car, route, LIGHTINGS["day"], moving=False)
    )
    rows, columns = np.nonzero(image.any(axis=2))
    assert len(rows) > 3000
    assert columns.min() > CENTRE
    assert rows.min() > HORIZON - 30
