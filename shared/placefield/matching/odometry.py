"""Self-motion: where the metres that a vehicle has driven lead to, on a map that knows its own.

A vehicle at a place is anywhere in that place's cell, which reaches half way to its neighbours. Its
odometry is right to a few percent, or its wheels have slipped: then it has come any part of the
way. So there is no speed that is too high.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.motion import RESOLVED, SPEEDS, Array

Vector = NDArray[np.float64]
Places = NDArray[np.int32]

_SCALE = 0.05  # deviation of odometry, in terms of the way
_LEAST = 0.02  # likewise, in terms of the mean way between two places
_UNEVEN = 0.5  # likewise, of a pace that is assumed
_ASSUMED = 10  # frames without a reading that the pace before is assumed for
_SLIP = 0.02  # chance that a vehicle has come any part of the way only
_NARROWEST = 0.05  # least width of a cell, in terms of the mean
_BOX = 3**0.5  # half the width of a uniform density of deviation 1


class Road(NamedTuple):
    """The way along the K places of a map, in metres.

    Attributes:
        middles: (K,) float64, of the places' cells, ascending.
        borders: (K + 1,) float64, of these cells.
        spacing: mean width of a cell.
    """

    middles: Vector
    borders: Vector
    spacing: float


def road(travelled: Vector) -> Road | None:
    """Return the way along places at these metres, (K,), not descending; None without any way.

    Where the reference stood, cells are narrow, but not empty.
    """
    gaps = np.diff(travelled)
    spacing = float(gaps.mean()) if len(gaps) else 0.0
    if spacing == 0:
        return None
    places = np.concatenate([[0.0], np.cumsum(np.maximum(gaps, _NARROWEST * spacing))])
    ends = places[0] - spacing / 2, places[-1] + spacing / 2
    borders = np.concatenate([ends[:1], (places[1:] + places[:-1]) / 2, ends[1:]])
    return Road((borders[1:] + borders[:-1]) / 2, borders, spacing)


class Way(NamedTuple):
    """The way from one frame to the next, in metres.

    Attributes:
        metres: of it; negative where less was driven up to here than had been assumed.
        deviation: of these, from what was not told.
        pace: metres per frame lately.
        is_measured: whether the readings at both of its ends were.
    """

    metres: float
    deviation: float
    pace: float
    is_measured: bool


def measures_length(way: Way, road: Road) -> bool:
    """Whether a step in descriptor space can be compared with those of the map over such a way."""
    return way.is_measured and way.pace <= SPEEDS[RESOLVED - 1] * road.spacing


class Odometer:
    """The ways between frames, from the readings of an odometer that come with some of them."""

    def __init__(self) -> None:
        """Begin a drive."""
        self._forget(None)

    def _forget(self, reading: float | None) -> None:
        self._last, self._pace = reading, None
        self._assumed, self._frames = 0.0, 0

    _last: float | None
    _pace: float | None

    def way(self, reading: float | None) -> Way | None:
        """Return the way from the frame before to the next one, of which this is the reading.

        Of frames that have none the pace so far is assumed, for a while; the next reading says what
        that was wrong by. None if nothing is known: at first, and where the count began anew.
        """
        self._frames += 1
        if reading is None:
            return self._assume()
        if self._last is None or reading < self._last:
            self._forget(reading)
            return None
        driven, frames = reading - self._last, self._frames
        rest = driven - self._assumed
        self._last, self._pace = reading, driven / frames
        self._assumed, self._frames = 0.0, 0
        return Way(rest, 0.0, driven / frames, is_measured=frames == 1)

    def _assume(self) -> Way | None:
        if self._pace is None or self._frames > _ASSUMED:
            self._forget(None)
            return None
        self._assumed += self._pace
        return Way(self._pace, _UNEVEN * self._pace, self._pace, is_measured=False)


def reached_by(way: Way, road: Road, places: Places) -> Places:
    """Return where a way may lead on the map from these places, ascending."""
    half = np.diff(road.borders)[places] / 2 + _noise(road, way)
    low = road.middles[places] + min(way.metres, 0.0) - half
    high = road.middles[places] + max(way.metres, 0.0) + half
    count = len(road.middles)
    begins = np.clip(np.searchsorted(road.borders, low, side="right") - 1, 0, count)
    ends = np.clip(np.searchsorted(road.borders, high), begins, count)
    open_ranges = np.zeros(count + 1, np.int32)
    np.add.at(open_ranges, begins, 1)
    np.add.at(open_ranges, ends, -1)
    return np.flatnonzero(np.cumsum(open_ranges)).astype(np.int32)


def speeds_of(pace: float) -> Vector:
    """Return the distribution over ``SPEEDS``, (S,), of a vehicle of so many places per frame.

    It is between two of them, and never faster than the map resolves: odometry resolves it.
    """
    resolved = SPEEDS[:RESOLVED]
    pace = min(pace, resolved[-1])
    above = max(int(np.searchsorted(resolved, pace)), 1)
    share = (pace - resolved[above - 1]) / (resolved[above] - resolved[above - 1])
    distribution = np.zeros(len(SPEEDS))
    distribution[above - 1 : above + 1] = 1 - share, share
    return distribution


@kernel
def carry(places: Places, belief: Array, road: Road, way: Way, first: int, carried: Array) -> None:
    """Carry beliefs on by a way.

    Args:
        places: (n,) int32, where they are, ascending.
        belief: (n, 2) float32, on the map and on its reverse, which is driven the other way.
        road: of the whole map.
        way: that was driven.
        first: place of the map to which the first of ``carried`` belongs.
        carried: (2, 2, K) float32, the beliefs that stay at a place and those that come to it are
            added to it.
    """
    borders = road.borders
    last = first + carried.shape[2]
    for i in range(len(places)):
        for hypothesis in range(2):
            here = belief[i, hypothesis]
            if here == 0:
                continue
            low, high = _reach(road, places[i], way, hypothesis)
            place = max(int(np.searchsorted(borders, low, side="right")) - 1, first)
            while place < last and borders[place] < high:
                chance = _chance(road, places[i], way, hypothesis, place)
                part = 0 if place == places[i] else 1
                carried[part, hypothesis, place - first] += here * np.float32(chance)
                place += 1


@kernel
def carry_back(
    places: Places, ahead: Array, road: Road, way: Way, before: Places, carried: Array
) -> None:
    """Take how likely what follows is from a frame back over a way.

    Args:
        places: (n,) int32, ascending, that are believed in at the frame.
        ahead: (2, n, 2) float32, how likely the frame and those after it are in each, for a vehicle
            that stayed there and one that has come there.
        road: of the whole map.
        way: that was driven.
        before: (m,) int32, places at the frame before.
        carried: (m, 2) float32, receives how likely what follows is from each of them.
    """
    for j in range(len(before)):
        for hypothesis in range(2):
            low, high = _reach(road, before[j], way, hypothesis)
            total = np.float32(0)
            first = int(np.searchsorted(road.borders, low, side="right")) - 1
            i = int(np.searchsorted(places, first))
            while i < len(places) and road.borders[places[i]] < high:
                chance = _chance(road, before[j], way, hypothesis, places[i])
                part = 0 if places[i] == before[j] else 1
                total += ahead[part, i, hypothesis] * np.float32(chance)
                i += 1
            carried[j, hypothesis] = total


@kernel
def _reach(road: Road, place: int, way: Way, hypothesis: int) -> tuple[float, float]:
    """From where to where a way from a place may lead."""
    half = (road.borders[place + 1] - road.borders[place]) / 2
    noise = _noise(road, way)
    least = min(way.metres, 0.0) - half - noise
    most = max(way.metres, 0.0) + half + noise
    middle = road.middles[place]
    if hypothesis == 0:
        return middle + least, middle + most
    return middle - most, middle - least


@kernel
def _chance(road: Road, place: int, way: Way, hypothesis: int, end: int) -> float:
    """Chance that a way from one place leads into the cell of another."""
    half = (road.borders[place + 1] - road.borders[place]) / 2
    low = road.borders[end] - road.middles[place]
    high = road.borders[end + 1] - road.middles[place]
    if hypothesis == 1:
        low, high = -high, -low
    noise, metres = _noise(road, way), way.metres
    driven = _up_to(high - metres, half, noise) - _up_to(low - metres, half, noise)
    slip = max(abs(metres) / 2, noise)
    slipped = _up_to(high - metres / 2, half, slip) - _up_to(low - metres / 2, half, slip)
    return (1 - _SLIP) * driven + _SLIP * slipped


@kernel
def _noise(road: Road, way: Way) -> float:
    """Half the width of a uniform density that has the deviation of odometry."""
    return _BOX * (_SCALE * abs(way.metres) + _LEAST * road.spacing + way.deviation)


@kernel
def _up_to(x: float, a: float, b: float) -> float:
    """Distribution function of the sum of two uniform variables, of -a to a and of -b to b."""
    return (_ramp(x + a + b) - _ramp(x + a - b) - _ramp(x - a + b) + _ramp(x - a - b)) / (4 * a * b)


@kernel
def _ramp(x: float) -> float:
    return max(x, 0.0) ** 2 / 2
