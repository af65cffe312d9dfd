"""Where the metres that a vehicle travelled lead to, on a map that knows its own metres.

A place stands for a cell of its route. A vehicle at a place may be anywhere in its cell. Its
odometry is right to a few percent, unless its wheels slipped: then the vehicle may have travelled
any part of the displacement. A displacement may lead from chain to chain, see ``Chains``, but not
farther than all the chains are long.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.belief_kernels import pick
from placefield.matching.chains import Passages, passages_ahead, passages_behind, places_in
from placefield.matching.motion import LOSE, Array
from placefield.matching.odometry import Displacement
from placefield.matching.roads import Roads, RouteCells
from placefield.matching.trace import NEGLIGIBLE, Trace

Places = NDArray[np.int32]

_SCALE = 0.05  # deviation of odometry, as a fraction of the metres travelled
_LEAST = 0.02  # likewise, as a fraction of the mean gap between two places
_SLIP = 0.02  # chance that the wheels slipped: any part of the displacement is as likely
_GRAIN = 1 / 8  # ways that differ by less may count as one, as a fraction of the noise
_BOX = 3**0.5  # half the width of a uniform density of deviation 1


class Leg(NamedTuple):
    """The places of a chain, as seen from another one or from itself, see ``Passages``.

    Attributes:
        first: the first place.
        end: the place after the last one.
        shift: metres to add to those of the places.
        chance: of the way there.
    """

    first: int
    end: int
    shift: float
    chance: float


def reached_by(displacement: Displacement, roads: Roads, places: Places) -> Places:
    """Return the places that a displacement may lead to from these places, ascending."""
    assert roads.cells is not None
    cells = roads.cells
    count = len(cells.middles)
    begins, ends = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
    for rows, leg in _legs(displacement, roads, cells, places):
        some = places[rows]
        half = (cells.edges[some + 1] - cells.edges[some]) / 2 + _noise(cells, displacement)
        low = cells.middles[some] + min(displacement.metres, 0.0) - half - leg.shift
        high = cells.middles[some] + max(displacement.metres, 0.0) + half - leg.shift
        first = np.searchsorted(cells.edges, low, side="right") - 1
        begins.append(np.clip(first, leg.first, min(leg.end, count)))
        ends.append(np.clip(np.searchsorted(cells.edges, high), begins[-1], min(leg.end, count)))
    return places_in(np.concatenate(begins), np.concatenate(ends))


def carried_to(
    own: slice, by_place: Array, last: Trace | None, roads: Roads, displacement: Displacement
) -> Array:
    """Carry the beliefs of all shards to one shard's own places.

    Args:
        own: the shard's places in the map.
        by_place: (2, K) float32, the shard's beliefs, on the map and on its reverse.
        last: trace of the frame before, which has the beliefs of the other shards; None if there
            is none.
        roads: of the whole map, with cells.
        displacement: of the vehicle.

    Returns:
        The beliefs that stay at a place and those that come to it, (2, 2, K) float32.
    """
    assert roads.cells is not None
    carried = np.zeros((2, *by_place.shape), np.float32)
    least = NEGLIGIBLE / len(roads.cells.middles)
    inside = pick(by_place[0] + by_place[1], least)
    first = own.start
    places, belief = inside + np.int32(first), by_place.T[inside].copy()
    carry(places, belief, roads, displacement, first, carried)
    if last is not None:
        outside = (last.places < first) | (last.places >= own.stop)
        belief = (1 - LOSE) * last.belief[outside].sum(axis=2)
        carry(last.places[outside], belief.astype(np.float32), roads, displacement, first, carried)
    return carried


def carry(
    places: Places,
    belief: Array,
    roads: Roads,
    displacement: Displacement,
    first: int,
    carried: Array,
) -> None:
    """Move beliefs by a displacement.

    Args:
        places: (n,) int32, places of the beliefs, ascending.
        belief: (n, 2) float32, on the map and on its reverse, where the vehicle moves the other
            way.
        roads: of the map, with cells.
        displacement: of the vehicle.
        first: the place of the map that the first entry of ``carried`` is for.
        carried: (2, 2, K) float32; receives, added, the beliefs that stay at a place and those that
            come to it.
    """
    assert roads.cells is not None
    for rows, leg in _legs(displacement, roads, roads.cells, places):
        _carry(places[rows], belief[rows], roads.cells, displacement, leg, first, carried)


def carry_back(
    places: Places,
    message: Array,
    roads: Roads,
    displacement: Displacement,
    before: Places,
) -> Array:
    """Move the backward message of a frame back by a displacement.

    Args:
        places: (n,) int32, ascending, the places in the frame's trace.
        message: (2, n, 2) float32, likelihood of the frame and of those after it at each place, for
            a vehicle that stayed there and for one that has come there.
        roads: of the map, with cells.
        displacement: of the vehicle.
        before: (m,) int32, ascending, places at the frame before.

    Returns:
        The message at each of them, (m, 2) float32.
    """
    assert roads.cells is not None
    carried = np.zeros((len(before), 2), np.float32)
    for rows, leg in _legs(displacement, roads, roads.cells, before):
        _carry_back(places, message, roads.cells, displacement, before[rows], leg, carried[rows])
    return carried


def _legs(
    displacement: Displacement, roads: Roads, cells: RouteCells, places: Places
) -> Iterator[tuple[slice, Leg]]:
    """Yield where a displacement may lead from some places, (n,), ascending: their range, a leg."""
    edges = roads.chains.edges
    bounds = np.searchsorted(places, edges)
    sources = np.flatnonzero(bounds[:-1] < bounds[1:]).astype(np.int32)
    ends = cells.edges[np.minimum(edges, len(cells.middles))]
    noise = _noise(cells, displacement)
    reach = min(abs(displacement.metres) + noise, float(ends[-1] - ends[0]))
    itself = Passages(sources, sources, np.zeros(len(sources)), np.ones(len(sources), np.float32))
    ahead = passages_ahead(roads.junctions, ends, sources, reach, noise * _GRAIN)
    behind = passages_behind(roads.junctions, ends, sources, reach, noise * _GRAIN)
    for found in (itself, ahead, behind):
        for source, target, shift, chance in zip(*found, strict=True):
            leg = Leg(int(edges[target]), int(edges[target + 1]), float(shift), float(chance))
            yield slice(int(bounds[source]), int(bounds[source + 1])), leg


@kernel
def _carry(
    places: Places,
    belief: Array,
    cells: RouteCells,
    displacement: Displacement,
    leg: Leg,
    first: int,
    carried: Array,
) -> None:
    """Move beliefs to the places of a leg, see ``carry``."""
    edges, shift = cells.edges, leg.shift
    begin, end = max(leg.first, first), min(leg.end, first + carried.shape[2])
    for i in range(len(places)):
        for hypothesis in range(2):
            here = belief[i, hypothesis] * np.float32(leg.chance)
            if here == 0:
                continue
            low, high = _reach(cells, places[i], displacement, hypothesis)
            place = max(int(np.searchsorted(edges, low - shift, side="right")) - 1, begin)
            while place < end and edges[place] + shift < high:
                seen = edges[place] + shift, edges[place + 1] + shift
                chance = _chance(cells, places[i], displacement, hypothesis, seen)
                part = 0 if place == places[i] and shift == 0 else 1
                carried[part, hypothesis, place - first] += here * np.float32(chance)
                place += 1


@kernel
def _carry_back(
    places: Places,
    message: Array,
    cells: RouteCells,
    displacement: Displacement,
    before: Places,
    leg: Leg,
    carried: Array,
) -> None:
    """Add the message at the places of a leg, see ``carry_back``, to ``carried`` (m, 2) float32."""
    edges, shift = cells.edges, leg.shift
    for j in range(len(before)):
        for hypothesis in range(2):
            low, high = _reach(cells, before[j], displacement, hypothesis)
            total = np.float32(0)
            first = int(np.searchsorted(edges, low - shift, side="right")) - 1
            i = int(np.searchsorted(places, max(first, leg.first)))
            while i < len(places) and places[i] < leg.end and edges[places[i]] + shift < high:
                seen = edges[places[i]] + shift, edges[places[i] + 1] + shift
                chance = _chance(cells, before[j], displacement, hypothesis, seen)
                part = 0 if places[i] == before[j] and shift == 0 else 1
                total += message[part, i, hypothesis] * np.float32(chance)
                i += 1
            carried[j, hypothesis] += np.float32(leg.chance) * total


@kernel
def _reach(
    cells: RouteCells, place: int, displacement: Displacement, hypothesis: int
) -> tuple[float, float]:
    """Return from where to where a displacement from a place may lead, in metres."""
    half = (cells.edges[place + 1] - cells.edges[place]) / 2
    noise = _noise(cells, displacement)
    least = min(displacement.metres, 0.0) - half - noise
    most = max(displacement.metres, 0.0) + half + noise
    middle = cells.middles[place]
    if hypothesis == 0:
        return middle + least, middle + most
    return middle - most, middle - least


@kernel
def _chance(
    cells: RouteCells,
    place: int,
    displacement: Displacement,
    hypothesis: int,
    seen: tuple[float, float],
) -> float:
    """Return the chance that a displacement leads from a place to between two metres."""
    half = (cells.edges[place + 1] - cells.edges[place]) / 2
    low, high = seen[0] - cells.middles[place], seen[1] - cells.middles[place]
    if hypothesis == 1:
        low, high = -high, -low
    noise, metres = _noise(cells, displacement), displacement.metres
    rolled = _up_to(high - metres, half, noise) - _up_to(low - metres, half, noise)
    slip = max(abs(metres) / 2, noise)
    slipped = _up_to(high - metres / 2, half, slip) - _up_to(low - metres / 2, half, slip)
    return (1 - _SLIP) * rolled + _SLIP * slipped


@kernel
def _noise(cells: RouteCells, displacement: Displacement) -> float:
    """Return half the width of a uniform density that has the deviation of odometry, in metres."""
    return _BOX * (
        _SCALE * abs(displacement.metres) + _LEAST * cells.spacing + displacement.deviation
    )


@kernel
def _up_to(x: float, a: float, b: float) -> float:
    """Return the distribution function at x of the sum of two uniform variables, on ±a and ±b."""
    return (_ramp(x + a + b) - _ramp(x + a - b) - _ramp(x - a + b) + _ramp(x - a - b)) / (4 * a * b)


@kernel
def _ramp(x: float) -> float:
    return max(x, 0.0) ** 2 / 2
