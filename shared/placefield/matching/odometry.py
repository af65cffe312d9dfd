"""Odometry: where the metres that a vehicle travelled lead to, on a map that knows its own metres.

A place stands for a cell of the route, which reaches halfway to the neighbouring places. A vehicle
at a place may be anywhere in its cell. Its odometry is right to a few percent, unless its wheels
slipped: then the vehicle may have travelled any part of the displacement. With odometry no speed is
too high.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.motion import RESOLVED, SPEEDS, Array

Vector = NDArray[np.float64]
Places = NDArray[np.int32]

_SCALE = 0.05  # deviation of odometry, as a fraction of the metres travelled
_LEAST = 0.02  # likewise, as a fraction of the mean gap between two places
_UNEVEN = 0.5  # likewise, as a fraction of a pace that is assumed
_ASSUMED = 10  # so many frames without a reading keep the last pace
_SLIP = 0.02  # chance that the wheels slipped: any part of the displacement is as likely
_NARROWEST = 0.05  # least width of a cell, as a fraction of the mean
_BOX = 3**0.5  # half the width of a uniform density of deviation 1


class RouteCells(NamedTuple):
    """The cells of the K places along the route of a map, in metres.

    Attributes:
        middles: (K,) float64, of the cells, ascending.
        edges: (K + 1,) float64, of the cells.
        spacing: mean width of a cell.
    """

    middles: Vector
    edges: Vector
    spacing: float


def route_cells(travelled: Vector) -> RouteCells | None:
    """Return the cells of places at these metres along the route, (K,), not descending.

    Returns None if all places are at the same metre. Where the reference stood still, cells are
    narrow, but not empty.
    """
    gaps = np.diff(travelled)
    spacing = float(gaps.mean()) if len(gaps) else 0.0
    if spacing == 0:
        return None
    places = np.concatenate([[0.0], np.cumsum(np.maximum(gaps, _NARROWEST * spacing))])
    ends = places[0] - spacing / 2, places[-1] + spacing / 2
    edges = np.concatenate([ends[:1], (places[1:] + places[:-1]) / 2, ends[1:]])
    return RouteCells((edges[1:] + edges[:-1]) / 2, edges, spacing)


class Displacement(NamedTuple):
    """How far the vehicle moved from one frame to the next, in metres.

    Attributes:
        metres: the distance; negative if the vehicle travelled less than was assumed so far.
        deviation: of an assumed distance; 0 for a measured one.
        pace: latest metres per frame.
        is_measured: whether both frames had a reading.
    """

    metres: float
    deviation: float
    pace: float
    is_measured: bool


def measures_length(displacement: Displacement, route: RouteCells) -> bool:
    """Whether the step after this displacement can be compared with steps of the map."""
    return displacement.is_measured and displacement.pace <= SPEEDS[RESOLVED - 1] * route.spacing


class Odometer:
    """Turns the readings of an odometer, which may be missing, into displacements of frames."""

    def __init__(self) -> None:
        """Begin a drive."""
        self._forget(None)

    def _forget(self, reading: float | None) -> None:
        self._last, self._pace = reading, None
        self._assumed, self._frames = 0.0, 0

    _last: float | None
    _pace: float | None

    def displacement(self, reading: float | None) -> Displacement | None:
        """Return the displacement from the last frame to the next one, whose reading this is.

        For a frame without a reading, the last pace is assumed for a while. The next reading
        corrects the error of the assumption. None if nothing is known: at first, and where the
        odometer began anew.
        """
        self._frames += 1
        if reading is None:
            return self._assume()
        if self._last is None or reading < self._last:
            self._forget(reading)
            return None
        travelled, frames = reading - self._last, self._frames
        rest = travelled - self._assumed
        self._last, self._pace = reading, travelled / frames
        self._assumed, self._frames = 0.0, 0
        return Displacement(rest, 0.0, travelled / frames, is_measured=frames == 1)

    def _assume(self) -> Displacement | None:
        if self._pace is None or self._frames > _ASSUMED:
            self._forget(None)
            return None
        self._assumed += self._pace
        return Displacement(self._pace, _UNEVEN * self._pace, self._pace, is_measured=False)


def reached_by(displacement: Displacement, route: RouteCells, places: Places) -> Places:
    """Return the places that a displacement may lead to from these places, ascending."""
    half = np.diff(route.edges)[places] / 2 + _noise(route, displacement)
    low = route.middles[places] + min(displacement.metres, 0.0) - half
    high = route.middles[places] + max(displacement.metres, 0.0) + half
    count = len(route.middles)
    begins = np.clip(np.searchsorted(route.edges, low, side="right") - 1, 0, count)
    ends = np.clip(np.searchsorted(route.edges, high), begins, count)
    open_ranges = np.zeros(count + 1, np.int32)
    np.add.at(open_ranges, begins, 1)
    np.add.at(open_ranges, ends, -1)
    return np.flatnonzero(np.cumsum(open_ranges)).astype(np.int32)


def speeds_of(pace: float) -> Vector:
    """Return the distribution over ``SPEEDS``, (S,), of a vehicle at this pace in places per frame.

    It lies between two of the speeds, and is never faster than the map resolves, because odometry
    resolves the displacement.
    """
    resolved = SPEEDS[:RESOLVED]
    pace = min(pace, resolved[-1])
    above = max(int(np.searchsorted(resolved, pace)), 1)
    share = (pace - resolved[above - 1]) / (resolved[above] - resolved[above - 1])
    distribution = np.zeros(len(SPEEDS))
    distribution[above - 1 : above + 1] = 1 - share, share
    return distribution


@kernel
def carry(
    places: Places,
    belief: Array,
    route: RouteCells,
    displacement: Displacement,
    first: int,
    carried: Array,
) -> None:
    """Move beliefs by a displacement.

    Args:
        places: (n,) int32, places of the beliefs, ascending.
        belief: (n, 2) float32, on the map and on its reverse, where the vehicle moves the other
            way.
        route: cells of the whole map.
        displacement: of the vehicle.
        first: the place of the map that the first entry of ``carried`` is for.
        carried: (2, 2, K) float32; receives, added, the beliefs that stay at a place and those that
            come to it.
    """
    edges = route.edges
    last = first + carried.shape[2]
    for i in range(len(places)):
        for hypothesis in range(2):
            here = belief[i, hypothesis]
            if here == 0:
                continue
            low, high = _reach(route, places[i], displacement, hypothesis)
            place = max(int(np.searchsorted(edges, low, side="right")) - 1, first)
            while place < last and edges[place] < high:
                chance = _chance(route, places[i], displacement, hypothesis, place)
                part = 0 if place == places[i] else 1
                carried[part, hypothesis, place - first] += here * np.float32(chance)
                place += 1


@kernel
def carry_back(
    places: Places,
    message: Array,
    route: RouteCells,
    displacement: Displacement,
    before: Places,
    carried: Array,
) -> None:
    """Move the backward message of a frame back by a displacement.

    Args:
        places: (n,) int32, ascending, the places in the frame's trace.
        message: (2, n, 2) float32, likelihood of the frame and of those after it at each place, for
            a vehicle that stayed there and for one that has come there.
        route: cells of the whole map.
        displacement: of the vehicle.
        before: (m,) int32, places at the frame before.
        carried: (m, 2) float32, receives the message at each of them.
    """
    for j in range(len(before)):
        for hypothesis in range(2):
            low, high = _reach(route, before[j], displacement, hypothesis)
            total = np.float32(0)
            first = int(np.searchsorted(route.edges, low, side="right")) - 1
            i = int(np.searchsorted(places, first))
            while i < len(places) and route.edges[places[i]] < high:
                chance = _chance(route, before[j], displacement, hypothesis, places[i])
                part = 0 if places[i] == before[j] else 1
                total += message[part, i, hypothesis] * np.float32(chance)
                i += 1
            carried[j, hypothesis] = total


@kernel
def _reach(
    route: RouteCells, place: int, displacement: Displacement, hypothesis: int
) -> tuple[float, float]:
    """Return from where to where a displacement from a place may lead, in metres."""
    half = (route.edges[place + 1] - route.edges[place]) / 2
    noise = _noise(route, displacement)
    least = min(displacement.metres, 0.0) - half - noise
    most = max(displacement.metres, 0.0) + half + noise
    middle = route.middles[place]
    if hypothesis == 0:
        return middle + least, middle + most
    return middle - most, middle - least


@kernel
def _chance(
    route: RouteCells, place: int, displacement: Displacement, hypothesis: int, end: int
) -> float:
    """Return the chance that a displacement leads from one place into the cell of another."""
    half = (route.edges[place + 1] - route.edges[place]) / 2
    low = route.edges[end] - route.middles[place]
    high = route.edges[end + 1] - route.middles[place]
    if hypothesis == 1:
        low, high = -high, -low
    noise, metres = _noise(route, displacement), displacement.metres
    rolled = _up_to(high - metres, half, noise) - _up_to(low - metres, half, noise)
    slip = max(abs(metres) / 2, noise)
    slipped = _up_to(high - metres / 2, half, slip) - _up_to(low - metres / 2, half, slip)
    return (1 - _SLIP) * rolled + _SLIP * slipped


@kernel
def _noise(route: RouteCells, displacement: Displacement) -> float:
    """Return half the width of a uniform density that has the deviation of odometry, in metres."""
    return _BOX * (
        _SCALE * abs(displacement.metres) + _LEAST * route.spacing + displacement.deviation
    )


@kernel
def _up_to(x: float, a: float, b: float) -> float:
    """Return the distribution function at x of the sum of two uniform variables, on ±a and ±b."""
    return (_ramp(x + a + b) - _ramp(x + a - b) - _ramp(x - a + b) + _ramp(x - a - b)) / (4 * a * b)


@kernel
def _ramp(x: float) -> float:
    return max(x, 0.0) ** 2 / 2
