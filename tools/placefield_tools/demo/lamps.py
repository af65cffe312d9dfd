"""Street lamps: a post, an arm over the road, and at dusk a halo."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.light import Lighting
from placefield_tools.demo.render import View, draw_glow, draw_pole
from placefield_tools.demo.route import Route
from placefield_tools.demo.street import KERB, Lamp

HEIGHT = 6.2  # metres
ARM = 1.5
STEEL = 70.0
HALO = np.array([70.0, 150.0, 235.0])


@dataclass(frozen=True)
class LampPost:
    """World points (3,) of a lamp: the foot and the top of its post, and the tip of its arm."""

    foot: NDArray[np.float64]
    top: NDArray[np.float64]
    tip: NDArray[np.float64]


def make_lamp_post(lamp: Lamp, route: Route) -> LampPost:
    """Return `lamp` in the world."""
    offset = lamp.side * (KERB + 0.5)
    foot, top = route.point(lamp.arc, offset, [0.0, HEIGHT])
    return LampPost(foot, top, route.point(lamp.arc, offset - lamp.side * ARM, HEIGHT + 0.25))


def draw_lamp_post(view: View, post: LampPost, lighting: Lighting) -> None:
    """Draw a lamp post and, where lamps burn, its light."""
    steel = STEEL * np.array(lighting.ambient)
    draw_pole(view, post.foot, post.top, 0.13, steel)
    draw_pole(view, post.top, post.tip, 0.09, steel)
    head = post.tip + 0.35 * (post.top - post.tip)
    if lighting.lamps_on:
        draw_pole(view, post.tip, head, 0.2, np.array([190.0, 232.0, 255.0]))
        draw_glow(view, post.tip, HALO, 1.7)
    else:
        draw_pole(view, post.tip, head, 0.2, np.array([196.0, 196.0, 196.0]))
