"""The routes of a map and the links between them: a road network, a branch or a circuit.

The places of a map are those of its routes, one route after the other. A vehicle drives from each
place of a route to the next one, and along links.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Links = NDArray[np.int32]

NO_LINKS: Links = np.empty((0, 2), np.int32)
"""The links of a map of one line."""
NO_LINKS.setflags(write=False)


@dataclass(frozen=True, eq=False)
class RouteGraph:
    """The routes of a map with K places, and the links between places.

    Attributes:
        names: of the R routes.
        first: (R,) int32, the first place of each route, ascending from 0.
        links: (n, 2) int32, distinct and in ascending order: from the first place of a link, the
            vehicle may come to the second one in a step of one place, as from each place of a route
            to the next one.
    """

    names: tuple[str, ...]
    first: NDArray[np.int32]
    links: Links

    @property
    def is_line(self) -> bool:
        """Whether there is one route without links."""
        return len(self.first) == 1 and not len(self.links)

    def route_of(self, place: int) -> int:
        """Return the number of the route of a place."""
        return int(np.searchsorted(self.first, place, side="right")) - 1


def line(name: str) -> RouteGraph:
    """Return the graph of one route without links."""
    return RouteGraph((name,), np.zeros(1, np.int32), NO_LINKS)


def problem_of(graph: RouteGraph, count: int) -> str | None:
    """Describe what is wrong with a graph of ``count`` places; None if it is sound."""
    ends = np.append(graph.first, np.int32(count))
    if graph.first[0] != 0 or (np.diff(ends) <= 0).any():
        return "a route has no place"
    links = graph.links
    if len(links) and (links.min() < 0 or links.max() >= count):
        return "a link leads to no place"
    follows = (links[1:, 0] > links[:-1, 0]) | (
        (links[1:, 0] == links[:-1, 0]) & (links[1:, 1] > links[:-1, 1])
    )
    if not follows.all():
        return "the links are not distinct and in ascending order"
    within = (links[:, 1] == links[:, 0] + 1) & ~np.isin(links[:, 1], graph.first)
    if within.any():
        return "a link leads from a place to the next one of its route"
    return None
