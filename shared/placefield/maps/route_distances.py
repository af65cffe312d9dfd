"""Counts the steps between the places of a map.

A step leads from a place to the next one of its route, or along a link.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from placefield.maps.route_graph import RouteGraph


class RouteDistances:
    """The least numbers of steps from and to the places of a map, in the direction of travel."""

    def __init__(self, graph: RouteGraph, count: int) -> None:
        """Prepare for a map of ``count`` places."""
        self._ahead = _edges(graph, count)
        self._back = self._ahead.T.tocsr()

    def from_place(self, place: int) -> NDArray[np.float64]:
        """Return the least number of steps from a place to each, (K,); infinite without a way."""
        return _steps_from(self._ahead, place)

    def to_place(self, place: int) -> NDArray[np.float64]:
        """Return the least number of steps to a place from each, (K,); infinite without a way."""
        return _steps_from(self._back, place)


def places_near(graph: RouteGraph, count: int, place: int, tolerance: int) -> NDArray[np.int64]:
    """Return the places near one of ``count`` places, ascending, (n,) int64.

    They are at most ``tolerance`` steps ahead of it or behind it; the steps of one way may go in
    both directions.
    """
    edges = _edges(graph, count)
    (steps,) = dijkstra(edges, directed=False, unweighted=True, indices=[place], limit=tolerance)
    return np.flatnonzero(np.isfinite(steps))


def _edges(graph: RouteGraph, count: int) -> csr_array:
    """Return all steps of one place as a sparse matrix (K, K), from rows to columns."""
    edges = graph.edges(count)
    return coo_array((np.ones(len(edges)), tuple(edges.T)), shape=(count, count)).tocsr()


def _steps_from(edges: csr_array, place: int) -> NDArray[np.float64]:
    (steps,) = dijkstra(edges, unweighted=True, indices=[place])
    return np.asarray(steps)
