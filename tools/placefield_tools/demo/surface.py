"""The street's surface from above: road, parking bays, kerbs, pavements, gardens, markings."""

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield_tools.demo.light import Colour
from placefield_tools.demo.route import LEAD
from placefield_tools.demo.street import FRONT, KERB, Gap, Street
from placefield_tools.demo.texture import fractal_noise

HALF = 13.0  # metres painted to either side of the centre line
ACROSS = 20  # pixels per metre across the street
ALONG = 12  # pixels per metre along it
BAYS = KERB - 2.1  # metres from the centre line to the parking bays
OFFSETS = HALF - (np.arange(int(2 * HALF * ACROSS)) + 0.5) / ACROSS  # metres left, of each column
TILE = 512  # rows after which the surface's grain repeats

ASPHALT: Colour = (104, 100, 98)
BAY: Colour = (112, 112, 116)
KERBSTONE: Colour = (168, 172, 174)
SLAB: Colour = (146, 150, 154)
JOINT: Colour = (121, 125, 129)
LAWN: Colour = (58, 116, 92)
WHITE: Colour = (222, 224, 224)
MANHOLE: Colour = (66, 66, 68)

Surface = NDArray[np.float32]


def rows_between(start: float, end: float) -> slice:
    """Return the rows of the surface from `start` to `end` metres of the route."""
    first, last = (max(0, int((arc + LEAD) * ALONG)) for arc in (start, end))
    return slice(first, last)


def pixel(arc: float, offset: float) -> tuple[int, int]:
    """Return the column and row of a point of the street."""
    return int((HALF - offset) * ACROSS), int((arc + LEAD) * ALONG)


def paint_surface(street: Street) -> Surface:
    """Return the colours of the surface, float32 (rows, columns, 3), without any light.

    Row 0 lies `LEAD` metres behind the first frame; columns run from left to right.
    """
    rng = np.random.default_rng([street.seed, 20])
    grain = 5 * fractal_noise((TILE, len(OFFSETS)), 1.1, rng)
    grain += 7 * rng.standard_normal(grain.shape, dtype=np.float32)
    length = float(street.route.arc[-1])
    surface = np.empty((rows_between(-LEAD, length).stop, len(OFFSETS), 3), np.float32)
    _lay(surface)
    _repair(surface, length, rng)
    _mark(surface, length)
    for gap in street.gaps:
        _open(surface, gap)
    repeats = -(-len(surface) // TILE)
    surface += np.tile(grain, (repeats, 1))[: len(surface), :, None]
    return surface


def _lay(surface: Surface) -> None:
    """Lay asphalt, bays, kerbs and slabs along the whole street."""
    beside = abs(OFFSETS)
    surface[:] = ASPHALT
    surface[:, (beside > BAYS) & (beside < KERB)] = BAY
    slabs = np.flatnonzero(beside > KERB)
    surface[:, slabs] = SLAB
    surface[:, slabs[:: int(0.9 * ACROSS)]] = JOINT
    surface[:: int(0.9 * ALONG), slabs] = JOINT
    surface[:, (beside > KERB - 0.02) & (beside < KERB + 0.28)] = KERBSTONE


def _repair(surface: Surface, length: float, rng: np.random.Generator) -> None:
    """Put patches and manholes into the road, one every few metres."""
    for arc in np.arange(-LEAD, length, 7.0) + rng.uniform(0, 5):
        offset, half = rng.uniform(1 - KERB, KERB - 1), rng.uniform(0.4, 1.3)
        reach, fade = rng.uniform(1, 5), rng.uniform(0.8, 0.92)
        if rng.random() < 0.5:
            surface[rows_between(arc, arc + reach), abs(OFFSETS - offset) < half] *= fade
        else:
            axes = int(0.35 * ACROSS), int(0.35 * ALONG)
            cv2.ellipse(surface, pixel(arc, offset), axes, 0, 0, 360, MANHOLE, cv2.FILLED)


def _mark(surface: Surface, length: float) -> None:
    """Paint the broken centre line and the edges of the parking bays."""
    surface[:, abs(abs(OFFSETS) - BAYS) < 0.06] = WHITE
    for arc in np.arange(0.0, length, 6.0):
        surface[rows_between(arc, arc + 3.0), abs(OFFSETS) < 0.08] = WHITE


def _open(surface: Surface, gap: Gap) -> None:
    """Lead a side street in, with a crossing before it, or sow a garden's lawn."""
    rows = rows_between(gap.start, gap.start + gap.width)
    if gap.kind == "garden":
        surface[rows, gap.side * OFFSETS > FRONT] = LAWN
        return
    surface[rows, gap.side * OFFSETS > BAYS] = ASPHALT
    crossing = rows_between(gap.start - 3.6, gap.start - 0.6)
    road = abs(OFFSETS) < KERB - 0.2
    surface[crossing, road] = ASPHALT
    surface[crossing, road & (OFFSETS % 1.0 < 0.5)] = WHITE
