"""The chains of a map's places, and the passages that lead from chain to chain.

A chain is a run of places with one way: a vehicle comes to each of its places but the first only
from the place before, and leaves each but the last only for the place after. So links lead from the
ends of chains to the beginnings of chains. A map of one route without links is one chain.

At the end of a chain a vehicle takes each way with the same chance. In reverse, it takes each way
at the beginning of a chain with the same chance.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.maps.route_graph import RouteGraph
from placefield.matching.motion import REACH

Vector = NDArray[np.float64]
Places = NDArray[np.int32]
Ways = tuple[tuple[tuple[int, float], ...], ...]
"""Of each chain, the chains that follow it, and the chance of each."""

_LEAST = 1e-6  # chance of a passage; those of less are left out


class Passages(NamedTuple):
    """Ways from chains to chains, along other chains if need be.

    Attributes:
        source: (n,) int32, the chain that each begins in.
        target: (n,) int32, the chain that it ends in.
        shift: (n,) float64: what is at x in the target is at x + shift, seen from the source.
        chance: (n,) float32, of this way, for a vehicle that leaves the source.
    """

    source: NDArray[np.int32]
    target: NDArray[np.int32]
    shift: Vector
    chance: NDArray[np.float32]


class Chains(NamedTuple):
    """The C chains of a map of K places, and the passages of a few places.

    Attributes:
        edges: (C + 1,) int32, the first place of each chain, then K.
        ahead: the passages, with shifts in places.
        behind: the same for a vehicle that moves in reverse.
    """

    edges: Places
    ahead: Passages
    behind: Passages

    @property
    def is_one(self) -> bool:
        """Whether there is one chain, and no passage from its end to its beginning."""
        return len(self.edges) == 2 and not len(self.ahead.source)

    def of(self, places: Places) -> Places:
        """Return the number of the chain of each place, (n,) int32."""
        return np.asarray(np.searchsorted(self.edges[1:-1], places, side="right"), np.int32)


class Junctions(NamedTuple):
    """The ways from each chain to the next ones.

    Attributes:
        ahead: to the chains that follow each.
        behind: to those that precede it.
    """

    ahead: Ways
    behind: Ways


NO_PASSAGES = Passages(
    np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0), np.empty(0, np.float32)
)
ONE_CHAIN = Chains(np.array([0, np.iinfo(np.int32).max], np.int32), NO_PASSAGES, NO_PASSAGES)
"""The chain of a line of any number of places."""
NO_JUNCTIONS = Junctions(((),), ((),))
"""The junctions of a line."""


def junctions_of(graph: RouteGraph, count: int) -> tuple[Places, Junctions]:
    """Return the edges of the chains of a graph of ``count`` places, see ``Chains``, and the ways.

    A line has the edges of ``ONE_CHAIN``.
    """
    if graph.is_line:
        return ONE_CHAIN.edges, NO_JUNCTIONS
    links = graph.links
    begins = np.unique(np.concatenate([graph.first, links[:, 1], links[:, 0] + 1]))
    edges = np.append(begins[begins < count], count).astype(np.int32)
    steps = graph.edges(count)
    between = steps[np.isin(steps[:, 1], edges)]
    here, there = (np.searchsorted(edges, side, side="right") - 1 for side in between.T)
    chains = len(edges) - 1
    return edges, Junctions(_ways(here, there, chains), _ways(there, here, chains))


def _ways(here: NDArray[np.intp], there: NDArray[np.intp], count: int) -> Ways:
    """Return the ways of each chain, given those from each chain ``here`` to one ``there``."""
    ways: list[list[int]] = [[] for _ in range(count)]
    for source, target in zip(here.tolist(), there.tolist(), strict=True):
        ways[source].append(target)
    return tuple(tuple((target, 1 / len(each)) for target in each) for each in ways)


def chains_of(graph: RouteGraph, count: int, reach: int = REACH) -> Chains:
    """Return the chains of a graph of ``count`` places, with passages of up to ``reach`` places."""
    edges, junctions = junctions_of(graph, count)
    return chains_between(edges, junctions, reach)


def chains_between(edges: Places, junctions: Junctions, reach: int = REACH) -> Chains:
    """Return the chains with these edges and junctions, see ``chains_of``."""
    sources, ends = np.arange(len(edges) - 1, dtype=np.int32), edges.astype(np.float64)
    return Chains(
        edges,
        passages_ahead(junctions, ends, sources, reach),
        passages_behind(junctions, ends, sources, reach),
    )


def passages_ahead(
    junctions: Junctions, edges: Vector, sources: Places, reach: float, grain: float = 1.0
) -> Passages:
    """Return the passages from the ends of some chains to all chains nearer than ``reach``.

    Args:
        junctions: of all chains.
        edges: (C + 1,) where each chain begins, and the last one ends, in any unit of length.
        sources: (n,) int32, numbers of chains.
        reach: in that unit, from the end of the source to the beginning of the target.
        grain: in that unit; ways to a chain whose lengths differ by less may count as one.
    """
    found = [
        (source, target, edges[source + 1] + distance - edges[target], chance)
        for source in sources.tolist()
        for target, distance, chance in _within(junctions.ahead, edges, source, (reach, grain))
    ]
    return _passages(found)


def passages_behind(
    junctions: Junctions, edges: Vector, sources: Places, reach: float, grain: float = 1.0
) -> Passages:
    """Return the passages from the beginnings of some chains back to the ends of all chains.

    See ``passages_ahead`` for the arguments.
    """
    found = [
        (source, target, edges[source] - distance - edges[target + 1], chance)
        for source in sources.tolist()
        for target, distance, chance in _within(junctions.behind, edges, source, (reach, grain))
    ]
    return _passages(found)


def crossed_to(chains: Chains, places: Places) -> Places:
    """Return where passages may lead in a step from some places, (n,); both ascend."""
    edges, ahead = chains.edges, chains.ahead
    last = np.searchsorted(places, edges[ahead.source + 1]) - 1  # place before the passage
    active = np.flatnonzero(last >= 0)
    begins, source = edges[ahead.target[active]], edges[ahead.source[active]]
    farthest = places[last[active]] - ahead.shift[active].astype(np.int64) + REACH + 1
    ends = np.minimum(farthest, edges[ahead.target[active] + 1])
    leads = (ends > begins) & (places[last[active]] >= source)
    return places_in(begins[leads], ends[leads])


def crossed_back_to(chains: Chains, places: Places) -> Places:
    """Return where passages may lead in a step in reverse; see ``crossed_to``."""
    edges, behind = chains.edges, chains.behind
    first = np.searchsorted(places, edges[behind.source])  # place after the passage
    active = np.flatnonzero(first < len(places))
    source, target = behind.source[active], behind.target[active]
    nearest = places[first[active]] - behind.shift[active].astype(np.int64)
    begins, ends = np.maximum(nearest - REACH, edges[target]), edges[target + 1]
    leads = (ends > begins) & (places[first[active]] < edges[source + 1])
    return places_in(begins[leads], ends[leads])


def places_in(begins: NDArray[np.integer], ends: NDArray[np.integer]) -> Places:
    """Return the places in at least one of n ranges, ascending."""
    order = np.argsort(begins, kind="stable")
    begins, ends = begins[order], ends[order]
    begins = np.maximum(begins, np.maximum.accumulate(np.append(0, ends[:-1]))[: len(begins)])
    counts = np.maximum(ends - begins, 0)
    before = np.cumsum(counts) - counts
    shift = np.repeat(begins - before, counts)
    return np.asarray(shift + np.arange(len(shift)), np.int32)


def _passages(found: list[tuple[int, int, float, float]]) -> Passages:
    if not found:
        return NO_PASSAGES
    source, target, shift, chance = zip(*found, strict=True)
    return Passages(
        np.array(source, np.int32),
        np.array(target, np.int32),
        np.array(shift, np.float64),
        np.array(chance, np.float32),
    )


def _within(
    ways: Ways, edges: Vector, source: int, limits: tuple[float, float]
) -> Iterator[tuple[int, float, float]]:
    """Yield the chains after one, how far away they are, and the chance to come there.

    A chain is yielded once for each distance, rounded to the grain; ``limits`` are reach and grain.
    """
    reach, grain = limits
    ahead = {(0, chain): (0.0, chance) for chain, chance in ways[source]}
    while ahead:
        nearest = min(ahead)
        (_, chain), (distance, chance) = nearest, ahead.pop(nearest)
        if distance >= reach or chance < _LEAST:
            continue
        yield chain, distance, chance
        end = distance + float(edges[chain + 1] - edges[chain])
        for following, share in ways[chain]:
            there = round(end / grain), following
            first, before = ahead.get(there, (end, 0.0))
            ahead[there] = first, before + chance * share
