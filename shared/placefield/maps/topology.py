"""How the places of a map follow each other, and which of them are the same."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.maps.route_graph import RouteGraph, line


@dataclass(frozen=True, eq=False)
class Topology:
    """How the K places of a map follow each other.

    Attributes:
        graph: the routes and links.
        travelled: (K,) float64, metres up to each place along its route, never descending in a
            route; (0,) if unknown.
        same: (K,) int32, which place each is the same as, see ``Places``.
    """

    graph: RouteGraph
    travelled: NDArray[np.float64]
    same: NDArray[np.int32]

    @property
    def count(self) -> int:
        """K."""
        return len(self.same)

    def reversed(self) -> "Topology":
        """Return the topology of the same places in reverse order, driven in reverse."""
        travelled = self.travelled
        if len(travelled):
            travelled = travelled[-1] - travelled[::-1]
        same = np.int32(self.count - 1) - self.same[::-1]
        return Topology(self.graph.reversed(self.count), travelled, same)


def line_of(count: int) -> Topology:
    """Return the topology of one route of so many places, all different, of unknown metres."""
    return Topology(line(""), np.empty(0), np.arange(count, dtype=np.int32))
