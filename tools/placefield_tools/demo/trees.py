"""Trees and hedges: pictures of leaves."""

from collections.abc import Iterator

import cv2
import numpy as np

from placefield_tools.demo.light import Colour, Lighting
from placefield_tools.demo.render import Billboard, Panel
from placefield_tools.demo.street import FRONT, Street
from placefield_tools.demo.street_layout import TREE_KINDS
from placefield_tools.demo.texture import Canvas, Texture, make_texture

TREE_WIDTH = 6.0  # metres that a picture spans; a tree is scaled to its height
TREE_HEIGHT = 8.0
HEDGE_HEIGHT = 1.4
FRINGE: Colour = (46, 84, 66)  # what a leaf's edge blends into
BARK: Colour = (50, 61, 73)


def trees(street: Street, lighting: Lighting) -> Iterator[Billboard]:
    """Yield the trees of a street."""
    pictures = [_paint_tree(kind, street.seed, lighting) for kind in range(TREE_KINDS)]
    for tree in street.trees:
        foot = street.route.point(tree.arc, tree.offset)
        width = tree.height * TREE_WIDTH / TREE_HEIGHT
        yield Billboard(foot, width, tree.height, pictures[tree.kind])


def hedges(street: Street, lighting: Lighting) -> Iterator[Panel]:
    """Yield the hedges between the gardens and the pavement."""
    for gap in street.gaps:
        if gap.kind == "garden":
            ends = [gap.start, gap.start + gap.width]
            first, last = street.route.point(ends, gap.side * FRONT)
            up = np.array([0.0, 0.0, HEDGE_HEIGHT])
            yield Panel(first, last - first, up, _paint_hedge(gap.width, lighting))


def _paint_tree(kind: int, seed: int, lighting: Lighting) -> Texture:
    """Return the picture of a tree of `kind`."""
    rng = np.random.default_rng([seed, 22, kind])
    canvas = Canvas(TREE_WIDTH, TREE_HEIGHT)
    canvas.rectangle(0, 0, TREE_WIDTH, TREE_HEIGHT, FRINGE)
    canvas.clear()
    middle = TREE_WIDTH / 2
    trunk = [(middle - 0.2, 0.0), (middle + 0.2, 0.0), (middle + 0.1, 4.0), (middle - 0.1, 4.0)]
    canvas.polygon(trunk, BARK)
    for reach in (-1.3, -0.6, 0.7, 1.4):
        bough = [(middle - 0.1, 2.6), (middle + 0.1, 2.6), (middle + reach, 5.0)]
        canvas.polygon(bough, BARK)
    _paint_leaves(canvas, rng)
    return make_texture(canvas.lit(np.array([lighting.in_street], np.float32)))


def _paint_hedge(width: float, lighting: Lighting) -> Texture:
    """Return a clipped hedge, `width` metres long."""
    rng = np.random.default_rng(round(width * 1000))
    canvas = Canvas(width, HEDGE_HEIGHT)
    canvas.rectangle(0, 0, width, HEDGE_HEIGHT, (34, 76, 54))
    canvas.rectangle(0, HEDGE_HEIGHT - 0.15, width, HEDGE_HEIGHT, (44, 104, 76))
    canvas.grain(rng.standard_normal(canvas.cover.shape, dtype=np.float32), 11)
    canvas.shade(0, 0, width, 0.25, 0.6)
    return make_texture(canvas.lit(lighting.on_facade(lighting.sun_side, canvas.row_heights())))


def _paint_leaves(canvas: Canvas, rng: np.random.Generator) -> None:
    """Dab leaves in clumps, the dark ones first and the light ones up and towards the sun."""
    hue = np.array([42.0, 100.0, 78.0]) + rng.uniform(-1, 1) * np.array([8, 8, 18])
    wide, tall = rng.uniform(1.9, 2.4), rng.uniform(2.1, 2.6)
    angle, reach = rng.uniform(0, 2 * np.pi, 16), np.sqrt(rng.uniform(0, 1, 16)) * 0.72
    clumps = np.stack(
        [TREE_WIDTH / 2 + wide * reach * np.cos(angle), 5.2 + tall * reach * np.sin(angle)], axis=1
    )
    for brightness, lift, count in (
        (0.45, 0, 90),
        (0.72, 0.2, 70),
        (1.0, 0.38, 50),
        (1.28, 0.5, 24),
    ):
        for x, z in clumps:
            dabs = rng.normal((x + 0.3 * lift, z + lift), 0.36, (count, 2))
            tone = hue * brightness * (0.66 + 0.07 * z)
            for centre in canvas.pixels(dabs).tolist():
                cv2.circle(canvas.albedo, centre, 2, (tone * rng.uniform(0.8, 1.2)).tolist(), -1)
                cv2.circle(canvas.cover, centre, 2, (255,), -1)
