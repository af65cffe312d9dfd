"""What stands along a street."""

from dataclasses import dataclass
from typing import Literal

from placefield_tools.demo.light import Colour
from placefield_tools.demo.route import Route

KERB = 5.4  # metres from the centre line to the edge of the road
FRONT = 8.4  # metres from the centre line to the façades
VISIBLE_RANGE = 95.0  # metres that the camera sees in front

Side = Literal[-1, 1]  # +1 left of the centre line, -1 right
Material = Literal["plaster", "brick", "stone", "glass"]
Roof = Literal["flat", "mansard", "gable", "spire"]


@dataclass(frozen=True)
class Shop:
    """A shop on the ground floor: its name, its colour, and what sticks out above its window."""

    name: str
    colour: Colour
    awning: bool
    blade: bool


@dataclass(frozen=True)
class Building:
    """A building; lengths in metres, `start` along the route, `setback` behind the street front."""

    side: Side
    start: float
    width: float
    setback: float
    ground_height: float
    storey_height: float
    floors: int
    bays: int
    material: Material
    wall: Colour
    trim: Colour
    shutters: Colour | None
    roof: Roof
    shop: Shop | None
    balconies: bool
    seed: int

    @property
    def end(self) -> float:
        """Metres along the route at which the building ends."""
        return self.start + self.width

    @property
    def behind_gap(self) -> bool:
        """Whether the building stands back from the street and closes the view through a gap."""
        return self.setback > 10

    @property
    def depth(self) -> float:
        """Metres that the building reaches back from its front; a tower is square."""
        return self.width if self.roof == "spire" else 14.0

    @property
    def eaves(self) -> float:
        """Height of the wall in metres, without the roof."""
        return self.ground_height + self.floors * self.storey_height + 0.7

    @property
    def front(self) -> float:
        """Offset of the façade from the centre line in metres, positive to the left."""
        return self.side * (FRONT + self.setback)


@dataclass(frozen=True)
class Gap:
    """An opening between buildings: a side street, or a garden behind a wall."""

    side: Side
    start: float
    width: float
    kind: Literal["street", "garden"]


@dataclass(frozen=True)
class Tree:
    """A tree; `kind` picks its picture."""

    arc: float
    offset: float
    height: float
    kind: int


@dataclass(frozen=True)
class Lamp:
    """A street lamp on a post beside the kerb."""

    arc: float
    side: Side


@dataclass(frozen=True)
class Car:
    """A car at `arc`, `offset`; `direction` is +1 if it points along the route."""

    arc: float
    offset: float
    direction: Literal[-1, 1]
    model: int
    paint: Colour


@dataclass(frozen=True)
class Street:
    """A route and everything that stands along it."""

    seed: int
    route: Route
    buildings: tuple[Building, ...]
    gaps: tuple[Gap, ...]
    trees: tuple[Tree, ...]
    lamps: tuple[Lamp, ...]
    parked: tuple[Car, ...]
