"""The routes of a map and the links between them: a road network, a branch or a circuit.

The places of a map are those of its routes, one route after the other. A vehicle drives from each
place of a route to the next one, and along links.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from placefield.config import Rule
from placefield.errors import ConfigError, MapError

Firsts = NDArray[np.int32]
Link = tuple[int, int]
Links = NDArray[np.int32]

ONE_ROUTE: Firsts = np.zeros(1, np.int32)
"""The first place of each route, in a map of one route."""
ONE_ROUTE.setflags(write=False)

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
    first: Firsts
    links: Links

    @property
    def is_line(self) -> bool:
        """Whether there is one route without links."""
        return len(self.first) == 1 and not len(self.links)

    def route_of(self, place: int) -> int:
        """Return the number of the route of a place."""
        return int(routes_of(self.first, place))

    def named(self, place: int) -> str:
        """Name a place for a person: its route, if there are several, and its number within it."""
        if len(self.names) == 1:
            return f"place {place}"
        route = self.route_of(place)
        return f"{self.names[route]}, place {place - self.first[route]}"

    def edges(self, count: int) -> Links:
        """Return all steps of one place in a graph of ``count`` places, (n, 2) int32.

        First come those from each place of a route to the next one, ascending, then the links.
        """
        following = np.setdiff1d(np.arange(1, count, dtype=np.int32), self.first)
        return np.concatenate([np.stack([following - 1, following], axis=1), self.links])

    def before(self, count: int) -> NDArray[np.int32]:
        """Return the likeliest place before each of ``count`` places, (K,) int32; -1 if none.

        It is the one with the fewest ways on; of several, the one before in the route.
        """
        edges = self.edges(count)
        ways = np.bincount(edges[:, 0], minlength=count)[edges[:, 0]]
        order = np.lexsort((np.arange(len(ways)), ways))[::-1]
        before = np.full(count, -1, np.int32)
        before[edges[order, 1]] = edges[order, 0]  # the last one of each place stays
        return before

    def reversed(self, count: int) -> "RouteGraph":
        """Return the graph of the same ``count`` places in reverse order, driven in reverse."""
        ends = np.append(self.first[1:], np.int32(count))
        links = np.int32(count - 1) - self.links[:, ::-1]
        order = np.lexsort((links[:, 1], links[:, 0]))
        return RouteGraph(self.names[::-1], np.int32(count) - ends[::-1], links[order])


def line(name: str) -> RouteGraph:
    """Return the graph of one route without links."""
    return RouteGraph((name,), ONE_ROUTE, NO_LINKS)


def routes_of(first: Firsts, places: ArrayLike) -> NDArray[np.intp]:
    """Return the number of the route of each place, given the first place of each route."""
    return np.asarray(np.searchsorted(first, places, side="right")) - 1


def as_links(pairs: set[Link]) -> Links:
    """Return links as an array, (n, 2) int32, in ascending order."""
    return np.array(sorted(pairs), np.int32).reshape(-1, 2)


def place_in(graph: RouteGraph, count: int, route: str, number: int) -> int:
    """Return the place of a map of ``count`` places by its route and its number within the route.

    Raises:
        MapError: there is no such route, or no such place in it.
    """
    if route not in graph.names:
        raise MapError(f"no route {route!r:.80}: the routes are {', '.join(graph.names)}")
    start, end = np.append(graph.first, count)[graph.names.index(route) :][:2].tolist()
    if not 0 <= number < end - start:
        raise MapError(f"{route} has no place {number}, but places 0 to {end - start - 1}")
    return int(start + number)


def check_rule(rule: Rule, routes: int) -> None:
    """Refuse a rule that cannot follow a map of so many routes.

    In one route, a rule of windows of consecutive places does not follow links.

    Raises:
        ConfigError: the rule compares windows, and there are several routes.
    """
    if rule != "filter" and routes > 1:
        raise ConfigError(
            f"rule {rule}: does not follow several routes, as this map has: give --rule filter"
        )


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
