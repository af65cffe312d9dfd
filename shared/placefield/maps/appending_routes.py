"""Appends routes to a map: the stretches of a drive that it does not have."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, count, islice

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import Map, Places
from placefield.maps.map_metrics import change_metrics, with_places
from placefield.maps.route_graph import RouteGraph
from placefield.maps.stretches import Stretch
from placefield.maps.traverse import NO_PLACE, Traverse
from placefield.search.quantized import Quantized
from placefield.verification.local_features import NO_FEATURES
from placefield.verification.place_features import PlaceFeatures

Numbers = NDArray[np.intp]


def takes_places(places: Places, traverse: Traverse) -> bool:
    """Return whether places of a drive can be appended: with metres if the others have them."""
    return not len(places.travelled) or len(traverse.travelled) > 0


def with_routes(
    opened: Map, traverse: Traverse, stretches: Sequence[Stretch], descriptors: Quantized
) -> Map:
    """Return a map with each stretch of a drive as a route after its own, without looks.

    The new places lie in no segment: the rule ``filter`` needs none, and other rules follow no
    links.

    Args:
        opened: the map, with its identity.
        traverse: the drive of F frames; its poses are in the map's coordinate frame.
        stretches: of the drive; at least one.
        descriptors: (F, N) int16, the quantized descriptors of the drive.
    """
    routes = [descriptors[stretch.frames] for stretch in stretches]
    graph = _with_stretches(opened.graph, traverse.name, stretches, opened.places.count)
    grown = change_metrics(opened, lambda metric: with_places(metric, routes, graph))
    inactive = np.zeros(sum(map(len, routes)), np.int32)
    return replace(
        grown,
        places=_with_frames(opened.places, traverse, [each.frames for each in stretches]),
        local_features=_with_views(opened.local_features, traverse, stretches),
        channels=tuple(
            replace(channel, labels=np.append(channel.labels, inactive))
            for channel in grown.channels
        ),
        graph=graph,
    )


def _with_frames(places: Places, traverse: Traverse, routes: Sequence[Numbers]) -> Places:
    frames, start = np.concatenate(routes), places.count
    thumbnails = [traverse.thumbnails[frame] for frame in frames.tolist()]
    end = places.thumbnail_ends[-1]
    lengths = np.array([len(thumbnail) for thumbnail in thumbnails], np.int64)
    return Places(
        stamps=np.concatenate([places.stamps, traverse.stamps[frames]]),
        poses=_with_poses(places.poses, traverse.poses, frames),
        travelled=_with_metres(places.travelled, traverse.travelled, routes),
        same=np.append(places.same, np.arange(start, start + len(frames), dtype=np.int32)),
        thumbnails=np.concatenate([places.thumbnails, np.frombuffer(b"".join(thumbnails), "u1")]),
        thumbnail_ends=np.concatenate([places.thumbnail_ends, end + np.cumsum(lengths)]),
    )


def _with_views(
    known: PlaceFeatures | None, traverse: Traverse, stretches: Sequence[Stretch]
) -> PlaceFeatures | None:
    if known is None:
        return None
    frames = np.concatenate([stretch.frames for stretch in stretches]).tolist()
    views = traverse.local_features or (NO_FEATURES,) * len(traverse.raw)
    return known.with_places([views[frame] for frame in frames])


def _with_poses(
    poses: NDArray[np.float64], added: NDArray[np.float64], frames: Numbers
) -> NDArray[np.float64]:
    if not len(poses):
        return poses
    unknown = np.full((len(frames), 3), np.nan)
    return np.concatenate([poses, added[frames] if len(added) else unknown])


def _with_metres(
    travelled: NDArray[np.float64], added: NDArray[np.float64], routes: Sequence[Numbers]
) -> NDArray[np.float64]:
    """Append the metres of routes; each begins where the one before ends."""
    if not len(travelled):
        return travelled
    for frames in routes:
        metres = added[frames] - added[frames[0]]
        travelled = np.concatenate([travelled, travelled[-1] + metres])
    return travelled


def _with_stretches(
    graph: RouteGraph, name: str, stretches: Sequence[Stretch], places: int
) -> RouteGraph:
    """Append a route for each stretch, with links from the place before and to the one after."""
    first, links = graph.first.tolist(), []
    for stretch in stretches:
        last = places + len(stretch.frames) - 1
        if stretch.before != NO_PLACE:
            links.append((stretch.before, places))
        if stretch.after != NO_PLACE:
            links.append((last, stretch.after))
        first.append(places)
        places = last + 1
    names = _with_names(graph.names, name, len(stretches))
    return RouteGraph(names, np.array(first, np.int32), graph.links).with_links(links)


def _with_names(names: tuple[str, ...], drive: str, routes: int) -> tuple[str, ...]:
    """Append the names of a drive's routes: its own name, with a number where that is taken."""
    numbered = chain([drive], (f"{drive} ({number})" for number in count(2)))
    free = (name for name in numbered if name not in names)
    return (*names, *islice(free, routes))
