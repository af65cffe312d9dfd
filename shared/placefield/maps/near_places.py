"""The places near a place of a map, along its routes and links."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from placefield.maps.route_graph import RouteGraph


def places_near(graph: RouteGraph, count: int, place: int, tolerance: int) -> NDArray[np.int64]:
    """Return the places at most so many steps before or behind a place, ascending, (n,) int64.

    A step leads from a place to the next one of its route, or along a link.
    """
    steps = graph.edges(count)
    table = coo_array((np.ones(len(steps)), tuple(steps.T)), shape=(count, count)).tocsr()
    ways = dijkstra(table, directed=False, unweighted=True, indices=[place], limit=tolerance)
    return np.flatnonzero(np.isfinite(ways[0]))
