"""The routes of a map, what they share, and the links between them, as text."""

import logging
from collections.abc import Iterator

import numpy as np

from placefield.maps.linking import overlaps
from placefield.maps.map import Map
from placefield.maps.route_graph import RouteGraph, routes_of
from placefield_tools.common.natural_sort import counted

log = logging.getLogger(__name__)


def route_lines(placemap: Map) -> Iterator[str]:
    """Describe the routes, overlaps and links of a map, a line each; nothing of a mere line."""
    graph = placemap.graph
    if graph.is_line:
        return
    counts = np.diff(graph.first, append=placemap.places.count).tolist()
    if len(counts) > 1:
        for name, count in zip(graph.names, counts, strict=True):
            yield f"route {name}: {counted(count, 'place')}"
    for overlap in overlaps(placemap.places.same, graph.first):
        later = _stretch(graph, overlap.first, overlap.last)
        earlier = _stretch(graph, overlap.twin_of_first, overlap.twin_of_last)
        yield f"{later}: the same stretch as {earlier}"
    for one, other in graph.links.tolist():
        yield f"link: from {graph.named(one)}, to {graph.named(other)}"


def unlinked(graph: RouteGraph) -> list[str]:
    """Return the names of the routes that no link joins to another route."""
    ends = routes_of(graph.first, graph.links)
    joined = np.unique(ends[ends[:, 0] != ends[:, 1]])
    return [name for number, name in enumerate(graph.names) if number not in joined]


def warn_of_unlinked(placemap: Map) -> None:
    """Warn of the routes of a network that nothing links to another route."""
    graph = placemap.graph
    if len(graph.names) == 1:
        return
    twins = _twins(placemap)
    for name in unlinked(graph):
        if name in twins:
            log.warning(
                "%s: is the same stretch as %s from start to end, so no link joins them; build "
                "both as traverses of one route, without --routes",
                name,
                twins[name],
            )
        else:
            log.warning(
                "%s: is linked to no other route: no stretch of it is surely one of theirs; give "
                "--link, if a vehicle can pass from one to the other",
                name,
            )


def _twins(placemap: Map) -> dict[str, str]:
    """Return by name another route that each route shares a stretch with, if there is one.

    Links begin and end at the ends of a shared stretch. Only if these are the ends of both routes,
    there is none.
    """
    graph, twins = placemap.graph, {}
    for overlap in overlaps(placemap.places.same, graph.first):
        later, earlier = (
            graph.names[graph.route_of(place)] for place in (overlap.first, overlap.twin_of_first)
        )
        if later != earlier:
            twins[later], twins[earlier] = earlier, later
    return twins


def _stretch(graph: RouteGraph, first: int, last: int) -> str:
    return f"{graph.named(first)} to {last - graph.first[graph.route_of(last)]}"
