"""Drawing flat things of the world into an image, as a camera sees them."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.light import Image
from placefield_tools.demo.pinhole_camera import FOCAL, HEIGHT, NEAR, WIDTH, PinholeCamera
from placefield_tools.demo.street import VISIBLE_RANGE
from placefield_tools.demo.texture import Texture


@dataclass(frozen=True)
class Panel:
    """A texture on a parallelogram: its lower left corner and two sides, all (3,) in metres."""

    origin: NDArray[np.float64]
    along: NDArray[np.float64]
    up: NDArray[np.float64]
    texture: Texture

    @property
    def corners(self) -> NDArray[np.float64]:
        """The four corners (4, 3), around."""
        a, b = self.along, self.up
        return self.origin + np.stack([0 * a, a, a + b, b])


@dataclass(frozen=True)
class Billboard:
    """A texture that always faces the camera; `foot` (3,) is the middle of its lower edge."""

    foot: NDArray[np.float64]
    width: float
    height: float
    texture: Texture


@dataclass(frozen=True)
class Mesh:
    """Flat convex faces, drawn in order; one that turns its back on the camera is left out.

    Attributes:
        points: world points, float64 (V, 3), face after face, each clockwise seen from outside;
            the first face is the shadow on the ground.
        starts: where each face's points begin, and where the last one's end, int (F + 1,).
        colours: colour of each face, float64 (F, 3).
        lights: world points that glow, float64 (K, 3).
        glows: colour of each glow, float64 (K, 3).
    """

    points: NDArray[np.float64]
    starts: NDArray[np.int64]
    colours: NDArray[np.float64]
    lights: NDArray[np.float64]
    glows: NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """An image in the making: `image` is drawn on, `sky` is what far things fade into."""

    image: Image
    sky: Image
    camera: PinholeCamera


def haze(distance: float) -> float:
    """Return the share of the sky's colour at `distance` metres; 1 from `VISIBLE_RANGE` on."""
    fade = min(max((distance - 0.75 * VISIBLE_RANGE) / (0.25 * VISIBLE_RANGE), 0.0), 1.0)
    return 1 - math.exp(-((distance / 130.0) ** 1.5)) * (1 - fade)


def draw_panel(view: View, panel: Panel) -> None:
    """Draw a panel over what is there; nothing happens where the camera does not see it."""
    start, end = _visible_part(view.camera, panel)
    if start >= end:
        return
    pixels, depth = _outline(view.camera, panel, start, end)
    left, top = (max(int(edge), 0) for edge in pixels.min(axis=0).tolist())
    right, bottom = (math.ceil(edge) for edge in pixels.max(axis=0).tolist())
    right, bottom = min(right, WIDTH), min(bottom, HEIGHT)
    if right <= left or bottom <= top:
        return
    below, _, above, _ = spans = np.hypot(*(pixels[[1, 2, 3, 0]] - pixels).T).tolist()
    source = panel.texture.fitting(max(below, above) / (end - start), max(spans[1], spans[3]))
    first, last = int(start * source.shape[1]), math.ceil(end * source.shape[1])
    homography = (
        np.array([[1.0, 0, -left - 0.5], [0, 1, -top - 0.5], [0, 0, 1]])
        @ view.camera.homography(panel.origin, panel.along, panel.up)
        @ _texels(source, first)
    )
    warped = cv2.warpPerspective(source[:, first:last], homography, (right - left, bottom - top))
    _, mask = cv2.threshold(cv2.extractChannel(warped, 3), 127, 255, cv2.THRESH_BINARY)
    area = slice(top, bottom), slice(left, right)
    share = haze(depth)
    if share > 0.05:
        warped = cv2.addWeighted(warped, 1 - share, view.sky[area], share, 0.0)
    cv2.copyTo(warped, mask, view.image[area])


def draw_billboard(view: View, billboard: Billboard) -> None:
    """Draw a billboard over what is there."""
    along = view.camera.right * billboard.width
    up = np.array([0.0, 0.0, billboard.height])
    draw_panel(view, Panel(billboard.foot - along / 2, along, up, billboard.texture))


def draw_mesh(view: View, mesh: Mesh) -> None:
    """Draw the faces of a mesh that are turned to the camera, in their order."""
    pixels, depth = view.camera.project(mesh.points)
    if depth.max() <= NEAR:
        return
    if depth.min() < NEAR:
        mesh = _cut_off(mesh, depth)
        pixels, depth = view.camera.project(mesh.points)
    first = mesh.starts[:-1]
    a, b = pixels[first + 1] - pixels[first], pixels[first + 2] - pixels[first]
    towards = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0
    colours = mix(mesh.colours, view.sky, pixels[0], haze(float(depth.mean()))).tolist()
    fixed = np.round(pixels * 16).astype(np.int32)  # cv2 takes corners in sixteenths of a pixel
    for face in np.flatnonzero(towards).tolist():
        corners = fixed[mesh.starts[face] : mesh.starts[face + 1]]
        cv2.fillConvexPoly(view.image, corners, colours[face], shift=4)
    facing = (mesh.lights - view.camera.position) @ view.camera.forward < depth.mean()
    for light in np.flatnonzero(facing):
        draw_glow(view, mesh.lights[light], mesh.glows[light], 0.75)


def draw_pole(
    view: View,
    foot: NDArray[np.float64],
    top: NDArray[np.float64],
    width: float,
    colour: NDArray[np.float64],
) -> None:
    """Draw a straight pole of `width` metres between two world points (3,)."""
    pixels, depth = view.camera.project(np.array([foot, top]))
    if depth.min() < NEAR:
        return
    thickness = max(1, round(FOCAL * width / depth[0]))
    shaft = np.round(pixels).astype(int).tolist()
    hazy = mix(colour, view.sky, pixels[0], haze(float(depth[0])))
    cv2.line(view.image, shaft[0], shaft[1], hazy.tolist(), thickness)


def draw_glow(
    view: View, point: NDArray[np.float64], colour: NDArray[np.float64], radius: float
) -> None:
    """Add a round halo of `radius` metres around a light at a world point (3,)."""
    pixels, depth = view.camera.project(point[None])
    if depth[0] < NEAR or haze(depth[0]) > 0.9:
        return
    size = int(np.clip(FOCAL * radius / depth[0], 3, 90))
    column, row = np.round(pixels[0]).astype(int)
    left, top = max(column - size, 0), max(row - size, 0)
    right, bottom = min(column + size + 1, WIDTH), min(row + size + 1, HEIGHT)
    if right <= left or bottom <= top:
        return
    x = (np.arange(left, right) - column) / size
    y = (np.arange(top, bottom) - row) / size
    fall = np.clip(1 - np.sqrt(x**2 + y[:, None] ** 2), 0, 1) ** 2.5 * (1 - haze(depth[0]))
    halo = fall[..., None] * np.append(colour, 0.0) * 1.6
    area = view.image[top:bottom, left:right]
    view.image[top:bottom, left:right] = cv2.add(area, halo.clip(0, 255).astype(np.uint8))


def mix(
    colours: NDArray[np.float64], sky: Image, pixel: NDArray[np.float64], share: float
) -> NDArray[np.float64]:
    """Return `colours` (..., 3) with a `share` of the sky's colour at `pixel` (2,)."""
    column = min(max(int(pixel[0]), 0), WIDTH - 1)
    row = min(max(int(pixel[1]), 0), HEIGHT - 1)
    return (1 - share) * colours + share * sky[row, column, :3]


def _cut_off(mesh: Mesh, depth: NDArray[np.float64]) -> Mesh:
    """Return what of a mesh lies beyond `NEAR`, given the depth of each of its points (V,)."""
    faces: list[list[NDArray[np.float64]]] = []
    colours = []
    for first, end, colour in zip(mesh.starts, mesh.starts[1:], mesh.colours, strict=False):
        face = []
        for i in range(first, end):
            j = i + 1 if i + 1 < end else first
            if depth[i] >= NEAR:
                face.append(mesh.points[i])
            if (depth[i] >= NEAR) != (depth[j] >= NEAR):
                crossing = (NEAR - depth[i]) / (depth[j] - depth[i])
                face.append(mesh.points[i] + crossing * (mesh.points[j] - mesh.points[i]))
        if face:
            faces.append(face)
            colours.append(colour)
    points = np.array([point for face in faces for point in face])
    starts = np.cumsum([0, *(len(face) for face in faces)])
    return Mesh(points, starts, np.array(colours), mesh.lights, mesh.glows)


def _visible_part(camera: PinholeCamera, panel: Panel) -> tuple[float, float]:
    """Return the part of `panel`, from start to end of its length, that lies beyond `NEAR`."""
    depth = float((panel.origin - camera.position) @ camera.forward)
    depth += min(0.0, float(panel.up @ camera.forward)) - NEAR
    slope = float(panel.along @ camera.forward)
    if abs(slope) < 1e-9:
        return (0.0, 1.0) if depth > 0 else (0.0, 0.0)
    crossing = -depth / slope
    return (max(0.0, crossing), 1.0) if slope > 0 else (0.0, min(1.0, crossing))


def _outline(
    camera: PinholeCamera, panel: Panel, start: float, end: float
) -> tuple[NDArray[np.float64], float]:
    """Return the corner pixels (4, 2) of `panel` from start to end, and its mean depth."""
    units = np.array([[start, end, end, start], [0.0, 0.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]])
    corners = camera.homography(panel.origin, panel.along, panel.up) @ units
    return (corners[:2] / corners[2]).T, float(corners[2].mean())


def _texels(source: Image, first: int) -> NDArray[np.float64]:
    """Return the map (3, 3) from a pixel of `source`, cut off before column `first`, to (a, b)."""
    rows, columns = source.shape[:2]
    return np.array(
        [[1 / columns, 0, (first + 0.5) / columns], [0, -1 / rows, 1 - 0.5 / rows], [0, 0, 1]]
    )
