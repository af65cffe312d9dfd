"""The traffic of one traverse: who comes the other way, and who overtakes."""

from dataclasses import dataclass, replace

import numpy as np

from placefield_tools.demo.cars import MODELS
from placefield_tools.demo.street import Car
from placefield_tools.demo.street_layout import PAINTS

LANE = 1.65  # metres from the centre line to the middle of a lane


@dataclass(frozen=True)
class Moving:
    """A car of the traffic: where it is at stamp 0, and its speed along the route."""

    car: Car
    speed: float  # metres per second; negative towards the camera

    def at(self, stamp: float) -> Car:
        """Return the car as it is `stamp` seconds into the traverse."""
        return replace(self.car, arc=self.car.arc + self.speed * stamp)


def make_traffic(seed: list[int], length: float, speed: float) -> tuple[Moving, ...]:
    """Return the traffic met on a traverse of `length` metres at `speed` metres per second."""
    rng = np.random.default_rng(seed)

    def car(arc: float, oncoming: bool) -> Car:
        model, paint = int(rng.integers(len(MODELS))), PAINTS[rng.integers(len(PAINTS))]
        if oncoming:
            return Car(arc, LANE, -1, model, paint)
        return Car(arc, -LANE, 1, model, paint)

    traffic = []
    arc = rng.uniform(40, 90)
    while arc < 2 * length + 100:
        traffic.append(Moving(car(arc, oncoming=True), -rng.uniform(10, 12)))
        arc += rng.uniform(50, 140)
    arc = rng.uniform(20, 35)
    while arc < length:
        traffic.append(Moving(car(arc, oncoming=False), speed * rng.uniform(1.05, 1.3)))
        arc += rng.uniform(110, 220)
    return tuple(traffic)
