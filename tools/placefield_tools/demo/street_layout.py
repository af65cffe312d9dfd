"""Making up a street from a seed."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from placefield_tools.demo.cars import MODELS
from placefield_tools.demo.light import Colour
from placefield_tools.demo.route import LEAD, make_route
from placefield_tools.demo.street import (
    FRONT,
    KERB,
    VISIBLE_RANGE,
    Building,
    Car,
    Gap,
    Lamp,
    Material,
    Roof,
    Shop,
    Side,
    Street,
    Tree,
)

PLASTERS: tuple[Colour, ...] = (
    (176, 206, 226), (120, 176, 222), (130, 150, 214), (196, 184, 160), (166, 196, 178),
    (222, 226, 228), (96, 118, 190), (150, 200, 232), (200, 196, 210), (168, 160, 150),
)  # fmt: skip
BRICKS: tuple[Colour, ...] = (
    (62, 76, 142), (70, 96, 168), (58, 64, 108), (110, 142, 176), (84, 90, 120),
)  # fmt: skip
STONES: tuple[Colour, ...] = ((168, 186, 198), (150, 158, 164), (140, 172, 196))
GLASSES: tuple[Colour, ...] = ((120, 104, 84), (112, 116, 86), (96, 92, 92))
SHUTTERS: tuple[Colour, ...] = (
    (70, 92, 52), (110, 76, 44), (52, 52, 116), (120, 124, 92), (64, 60, 58),
)  # fmt: skip
AWNINGS: tuple[Colour, ...] = (
    (44, 44, 178), (60, 110, 44), (140, 84, 36), (46, 140, 214), (96, 40, 110), (120, 120, 40),
)  # fmt: skip
PAINTS: tuple[Colour, ...] = (
    (228, 228, 226), (178, 176, 172), (52, 48, 46), (40, 40, 156), (136, 78, 40), (96, 92, 88),
    (70, 96, 66), (120, 164, 190), (60, 60, 64), (210, 206, 200),
)  # fmt: skip
SHOPS = (
    "BAKERY", "BOOKS", "CAFE", "PHARMACY", "FLOWERS", "HOTEL", "BISTRO", "RECORDS", "BIKES",
    "TAILOR", "MUSEUM", "CINEMA", "BANK", "TOYS", "OPTIK", "PIZZA", "BARBER", "GALLERY", "TEA",
    "MUSIC", "SHOES", "ATELIER", "POST", "KIOSK",
)  # fmt: skip
TRIMS: tuple[Colour, ...] = ((226, 232, 236), (226, 232, 236), (150, 166, 178), (74, 80, 88))
PALETTES: dict[Material, tuple[Colour, ...]] = {
    "plaster": PLASTERS,
    "brick": BRICKS,
    "stone": STONES,
    "glass": GLASSES,
}
TREE_KINDS = 6
BEHIND_SIDE_STREET = 24.0  # metres from the street front to the building that closes the view
BEHIND_GARDEN = 17.0


def make_street(seed: int, length: float) -> Street:
    """Return the street of `seed` for a drive of `length` metres.

    Every kind of thing has random numbers of its own, drawn along the route, so that a longer
    street of the same seed begins like a shorter one.
    """
    end = length + VISIBLE_RANGE
    buildings: list[Building] = []
    gaps: list[Gap] = []
    trees: list[Tree] = []
    parked: list[Car] = []
    sides: tuple[Side, Side] = (1, -1)
    for side in sides:
        row = list(_row(side, end, _generator(seed, 2, side)))
        openings = [thing for thing in row if isinstance(thing, Gap)]
        buildings += [thing for thing in row if isinstance(thing, Building)]
        gaps += openings
        trees += _kerb_trees(side, end, openings, _generator(seed, 3, side))
        trees += _garden_trees(openings, _generator(seed, 4, side))
        parked += _parked(side, end, openings, _generator(seed, 5, side))
    return Street(
        seed,
        make_route(seed, length + 1.5 * VISIBLE_RANGE),
        tuple(buildings),
        tuple(gaps),
        tuple(trees),
        tuple(_lamps(end)),
        tuple(parked),
    )


def _generator(seed: int, kind: int, side: Side) -> np.random.Generator:
    return np.random.default_rng([seed, kind, side + 1])


def _row(side: Side, end: float, rng: np.random.Generator) -> Iterator[Building | Gap]:
    """Yield one side of the street from its beginning: buildings, and now and then a gap."""
    arc = -LEAD + rng.uniform(0, 6)
    since_gap, since_tower = 0, 0
    while arc < end:
        if since_gap >= 2 and rng.random() < 0.3:
            gap = _gap(side, arc, rng)
            width, since_gap = gap.width, 0
            yield gap
            behind = BEHIND_SIDE_STREET if gap.kind == "street" else BEHIND_GARDEN
            yield _building(side, arc - 9, width + 18, behind, rng)
        elif since_tower >= 8 and rng.random() < 0.3:
            width, since_tower = 6.4, 0
            yield _tower(_building(side, arc, width, 0.0, rng))
        else:
            width = rng.uniform(7.5, 16.0)
            setback = float(rng.choice([0.0, 0.0, 0.0, 0.5, 1.2]))
            yield _building(side, arc, width, setback, rng)
            since_gap, since_tower = since_gap + 1, since_tower + 1
        arc += width


def _gap(side: Side, arc: float, rng: np.random.Generator) -> Gap:
    if rng.random() < 0.55:
        return Gap(side, arc, rng.uniform(8, 10), "street")
    return Gap(side, arc, rng.uniform(10, 18), "garden")


def _building(
    side: Side, start: float, width: float, setback: float, rng: np.random.Generator
) -> Building:
    """Return a building of its own look; shops and balconies only at the street front."""
    materials: tuple[Material, ...] = ("plaster", "brick", "stone", "glass")
    material = materials[rng.choice(4, p=[0.44, 0.30, 0.14, 0.12])]
    palette = PALETTES[material]
    glass, at_front = material == "glass", setback < BEHIND_GARDEN
    roofs: tuple[Roof, ...] = ("flat", "mansard", "gable")
    likes = np.array([1.0, 0.0, 0.0] if glass else [0.4, 0.35, 0.25 * (width < 11.5)])
    shutters = SHUTTERS[rng.integers(len(SHUTTERS))]
    shop = Shop(
        SHOPS[rng.integers(len(SHOPS))],
        AWNINGS[rng.integers(len(AWNINGS))],
        awning=bool(rng.random() < 0.5),
        blade=bool(rng.random() < 0.5),
    )
    return Building(
        side=side,
        start=start,
        width=width,
        setback=setback,
        ground_height=float(rng.uniform(3.4, 4.2)),
        storey_height=float(rng.uniform(2.9, 3.5)),
        floors=int(rng.integers(1, 5)) + (2 if glass else 0),
        bays=max(2, round(width / rng.uniform(2.2, 3.6))),
        material=material,
        wall=palette[rng.integers(len(palette))],
        trim=TRIMS[rng.integers(len(TRIMS))],
        shutters=shutters if material == "plaster" and rng.random() < 0.4 else None,
        roof=roofs[rng.choice(3, p=likes / likes.sum())],
        shop=shop if at_front and rng.random() < 0.55 else None,
        balconies=bool(at_front and not glass and rng.random() < 0.3),
        seed=int(rng.integers(2**31)),
    )


def _tower(building: Building) -> Building:
    """Return a church tower in the place of `building`."""
    return replace(
        building,
        material="stone",
        wall=STONES[building.seed % len(STONES)],
        storey_height=3.6,
        floors=4,
        bays=2,
        roof="spire",
        shop=None,
        shutters=None,
        balconies=False,
    )


def _kerb_trees(
    side: Side, end: float, gaps: list[Gap], rng: np.random.Generator
) -> Iterator[Tree]:
    """Yield rows of trees along the kerb, with pauses between."""
    arc = -LEAD
    while arc < end:
        for _ in range(rng.integers(2, 5)):
            arc += rng.uniform(9, 13)
            height, kind = rng.uniform(5.5, 8.5), int(rng.integers(TREE_KINDS))
            if not _in_side_street(arc, gaps):
                yield Tree(arc, side * (KERB + 0.9), height, kind)
        arc += rng.uniform(22, 50)


def _garden_trees(gaps: list[Gap], rng: np.random.Generator) -> Iterator[Tree]:
    """Yield four trees a garden."""
    for gap in gaps:
        for _ in range(4 if gap.kind == "garden" else 0):
            offset = gap.side * (FRONT + rng.uniform(3, 12))
            arc = gap.start + rng.uniform(1, gap.width - 1)
            yield Tree(arc, offset, rng.uniform(6, 11), int(rng.integers(TREE_KINDS)))


def _lamps(end: float) -> Iterator[Lamp]:
    """Yield lamps every 17 m, right and left in turn."""
    for number, arc in enumerate(np.arange(-10.0, end, 17.0)):
        yield Lamp(float(arc), 1 if number % 2 else -1)


def _parked(side: Side, end: float, gaps: list[Gap], rng: np.random.Generator) -> Iterator[Car]:
    """Yield the cars parked along the kerb, pointing the way that traffic goes on their side."""
    arc = -LEAD
    while arc < end:
        arc += 5.4 if rng.random() < 0.55 else rng.uniform(6, 26)
        model, paint = int(rng.integers(len(MODELS))), PAINTS[rng.integers(len(PAINTS))]
        if not _in_side_street(arc, gaps):
            yield Car(arc, side * (KERB - 1.05), -1 if side == 1 else 1, model, paint)


def _in_side_street(arc: float, gaps: list[Gap]) -> bool:
    """Tell whether `arc` lies in or just beside the mouth of a side street."""
    return any(
        gap.kind == "street" and gap.start - 3 < arc < gap.start + gap.width + 3 for gap in gaps
    )
