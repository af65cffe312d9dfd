"""Joins traverses of several routes to one traverse of a network, in one coordinate frame."""

import logging
from collections.abc import Sequence
from itertools import chain, count
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.geography import Origin
from placefield.maps.route_graph import RouteGraph, place_in
from placefield.maps.traverse import ROUTE, Traverse
from placefield.verification.local_features import NO_FEATURES, LocalFeatures

log = logging.getLogger(__name__)

GivenLink = tuple[str, int, str, int]
"""A link that a person gives: a route and the number of a place in it, and those it leads to."""


def join_routes(
    routes: Sequence[Traverse], links: Sequence[GivenLink] = (), *, same_frame: bool = False
) -> Traverse:
    """Join traverses of different routes to one traverse of all their routes.

    A route is named by the last part of its name, with a number if another has this name.
    The poses are those of all routes in the coordinate frame of the first one that has some, if
    they are georeferenced or ``same_frame`` says that they share a frame. Otherwise they are left
    out, which is logged. The metres travelled go on from route to route.

    Args:
        routes: traverses of one feature and one network of local features, each of one route or of
            several.
        links: between places of their routes, besides their own.
        same_frame: whether poses that are not georeferenced share one frame.

    Raises:
        MapError: a link leads from or to no place.
    """
    graph, places = _side_by_side(routes), sum(len(route.raw) for route in routes)
    poses, frame = _in_one_frame(routes, same_frame)
    return Traverse(
        ", ".join(graph.names),
        np.concatenate([route.raw for route in routes]),
        np.concatenate([route.stamps for route in routes]),
        poses,
        _travelled_on(routes),
        tuple(image for route in routes for image in route.thumbnails),
        frame,
        _views_of(routes),
        next((route.local_network for route in routes if route.local_features), None),
        graph=_with_links(graph, places, links),
    )


def _views_of(routes: Sequence[Traverse]) -> tuple[LocalFeatures, ...]:
    """Return the local features of all frames; a route without any has none in its frames."""
    if not any(route.local_features for route in routes):
        return ()
    views = (route.local_features or (NO_FEATURES,) * len(route.raw) for route in routes)
    return tuple(chain.from_iterable(views))


def _side_by_side(routes: Sequence[Traverse]) -> RouteGraph:
    """Return the graph of all routes, with the links that each traverse has."""
    starts = np.cumsum([0, *(len(route.raw) for route in routes[:-1])], dtype=np.int32)
    graphs = [route.routes for route in routes]
    return RouteGraph(
        _distinct([name for graph in graphs for name in graph.names]),
        np.concatenate([graph.first + start for graph, start in zip(graphs, starts, strict=True)]),
        np.concatenate([graph.links + start for graph, start in zip(graphs, starts, strict=True)]),
    )


def _distinct(names: Sequence[str]) -> tuple[str, ...]:
    """Return the last parts of names; one that was there before gets a number from 2 on."""
    found: list[str] = []
    for name in (PurePath(each).name for each in names):
        numbered = (f"{name} {number}" for number in count(2))
        found.append(next(each for each in chain([name], numbered) if each not in found))
    return tuple(found)


def _with_links(graph: RouteGraph, count: int, given: Sequence[GivenLink]) -> RouteGraph:
    """Return a graph of ``count`` places with further links; see ``join_routes`` for the errors."""
    links = []
    for route, number, to, to_number in given:
        try:
            one = place_in(graph, count, route, number)
            other = place_in(graph, count, to, to_number)
        except MapError as error:
            raise MapError(f"link {route}:{number},{to}:{to_number}: {error}") from None
        if other == one + 1 and other not in graph.first:
            raise MapError(f"link {route}:{number},{to}:{to_number}: is the next place already")
        links.append((one, other))
    return graph.with_links(links)


def _in_one_frame(routes: Sequence[Traverse], same_frame: bool) -> tuple[NDArray[np.float64], str]:
    """Return the poses of all routes and the name of their frame, see ``join_routes``."""
    posed = [route for route in routes if len(route.poses)]
    if not posed:
        return np.empty((0, 3)), ROUTE
    origins = [Origin.of_frame(route.pose_frame) for route in posed]
    shared = origins[0]
    if len(posed) > 1 and None in origins and (any(origins) or not same_frame):
        log.warning(
            "the poses are left out: those of %s are not georeferenced; give --same-frame if the "
            "poses of all routes are in the same metres",
            posed[origins.index(None)].name,
        )
        return np.empty((0, 3)), ROUTE
    poses = [np.full((len(route.raw), 3), np.nan) for route in routes]
    for own, route in zip(poses, routes, strict=True):
        origin = Origin.of_frame(route.pose_frame)
        if len(route.poses):
            own[:] = route.poses
            if shared is not None and origin is not None and origin != shared:
                _convert(own, origin, shared)
    return np.concatenate(poses), posed[0].pose_frame


def _convert(poses: NDArray[np.float64], origin: Origin, shared: Origin) -> None:
    """Write poses (n, 3) in the metres of another origin; the yaws stay, as north does."""
    for pose in (row for row in poses if np.isfinite(row[0])):
        pose[:2] = shared.to_local(*origin.to_degrees(*pose[:2]))


def _travelled_on(routes: Sequence[Traverse]) -> NDArray[np.float64]:
    """Return the metres travelled along all routes, with a mean step from route to route."""
    without = [route.name for route in routes if not len(route.travelled)]
    if without:
        if len(without) < len(routes):
            log.warning("%s: has no metres travelled, so the map keeps none", without[0])
        return np.empty(0)
    metres = [route.travelled - route.travelled[0] for route in routes]
    steps = sum(len(each) - 1 for each in metres)
    step = sum(float(each[-1]) for each in metres) / max(steps, 1)
    ends = np.cumsum([0.0, *(each[-1] + step for each in metres[:-1])])
    return np.concatenate([each + end for each, end in zip(metres, ends, strict=True)])
