"""Where a vehicle may move on a map: its chains, and the cells of its places in metres."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.maps.topology import Topology
from placefield.matching.chains import (
    NO_JUNCTIONS,
    ONE_CHAIN,
    Chains,
    Junctions,
    chains_between,
    junctions_of,
)

Vector = NDArray[np.float64]
Places = NDArray[np.int32]

_NARROWEST = 0.05  # least width of a cell, as a fraction of the mean


class RouteCells(NamedTuple):
    """The cells of the K places along the routes of a map, in metres.

    A cell reaches halfway to the neighbouring places. Cells of different routes adjoin as if one
    route followed the other, so that their metres are distinct.

    Attributes:
        middles: (K,) float64, of the cells, ascending.
        edges: (K + 1,) float64, of the cells.
        spacing: mean width of a cell.
    """

    middles: Vector
    edges: Vector
    spacing: float


class Roads(NamedTuple):
    """Where a vehicle may move on a map.

    Attributes:
        chains: of its places.
        junctions: of the chains.
        cells: of its places; None if their metres are not known.
    """

    chains: Chains = ONE_CHAIN
    junctions: Junctions = NO_JUNCTIONS
    cells: RouteCells | None = None


LINE = Roads()
"""One route of any number of places, of unknown metres."""


def roads_of(topology: Topology) -> Roads:
    """Return the roads of a map."""
    edges, junctions = junctions_of(topology.graph, topology.count)
    cells = None
    if len(topology.travelled):
        cells = route_cells(topology.travelled, topology.graph.first)
    return Roads(chains_between(edges, junctions), junctions, cells)


def route_cells(travelled: Vector, first: Places | None = None) -> RouteCells | None:
    """Return the cells of places at these metres along their routes, (K,), not descending.

    Returns None if all places of each route are at the same metre. Where the reference stood still,
    cells are narrow, but not empty.

    Args:
        travelled: metres of each place.
        first: (R,) int32, the first place of each route; None: there is one route.
    """
    gaps = np.diff(travelled)
    between = np.zeros(len(gaps), np.bool_)  # whether the gap is between two routes
    if first is not None:
        between[first[1:] - 1] = True
    spacing = float(gaps[~between].mean()) if not between.all() else 0.0
    if spacing == 0:
        return None
    widths = np.where(between, spacing, np.maximum(gaps, _NARROWEST * spacing))
    places = np.concatenate([[0.0], np.cumsum(widths)])
    ends = places[0] - spacing / 2, places[-1] + spacing / 2
    edges = np.concatenate([ends[:1], (places[1:] + places[:-1]) / 2, ends[1:]])
    return RouteCells((edges[1:] + edges[:-1]) / 2, edges, spacing)
