"""Drops a drive from a map: its looks, its alignment and the places that only it showed first."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.adding import check_growable
from placefield.maps.look_rows import look_rows, replace_looks
from placefield.maps.manifest import ChangeRecord, TraverseRecord
from placefield.maps.map import Map, MapAlignment, MapChannel, Places
from placefield.maps.map_metrics import change_metrics, without_places
from placefield.maps.route_graph import RouteGraph, routes_of
from placefield.maps.traverse import NO_PLACE

Kept = NDArray[np.bool_]


def number_of(traverses: Sequence[TraverseRecord], drive: str) -> int:
    """Return the number of a traverse of a map, by its name, the end of its path, or its number.

    Raises:
        MapError: there is none, or several, of this name; or its frames are the places.
    """
    names = [record.name for record in traverses]
    found = [number for number, record in enumerate(traverses) if record.is_named(drive)]
    if not found:
        found = [number for number, name in enumerate(names) if Path(name).name == drive]
    if not found and drive.isdecimal() and int(drive) < len(names):
        found = [int(drive)]
    if not found:
        droppable = [record.name for record in traverses if record.aligned is not None]
        known = ", ".join(droppable) or "none that can be dropped"
        raise MapError(f"{drive}: no drive of the map; there is {known}")
    if len(found) > 1:
        numbers = " or ".join(map(str, found))
        raise MapError(f"{drive}: several drives have this name; give the number, {numbers}")
    if traverses[found[0]].aligned is None:
        raise MapError(f"{drive}: its frames are the places, so it cannot be dropped")
    return found[0]


def drop_traverse(opened: Map, number: int) -> Map:
    """Return a map without a drive, as if it had never been added.

    What a map has learned from a drive when it was built, PCA and projections, stays.

    Args:
        opened: the map, with all its channels.
        number: of the traverse, from 1.

    Raises:
        MapError: see ``check_growable``; or a later drive shows a place that this one added.
    """
    rows = look_rows(check_growable(opened))
    name = opened.traverses[number].name
    routes = _routes_of(opened, number)
    kept = ~np.isin(routes_of(opened.graph.first, np.arange(opened.places.count)), routes)
    for other, alignment in opened.alignments.items():
        shown = alignment.places[alignment.places != NO_PLACE]
        if other != number and not kept[shown].all():
            raise MapError(
                f"{name}: added places that {opened.traverses[other].name} shows, too; drop that "
                "drive first"
            )
    moved = np.cumsum(kept, dtype=np.int32) - np.int32(1)
    others = rows.chosen(rows.traverses != number)
    others = others._replace(
        places=moved[others.places],
        traverses=others.traverses - (others.traverses > number).astype(np.int32),
    )
    shrunk = opened if kept.all() else _without_places(opened, kept, routes, moved)
    return replace(
        replace_looks(shrunk, others),
        traverses=(*opened.traverses[:number], *opened.traverses[number + 1 :]),
        alignments={
            other - (other > number): MapAlignment(
                np.where(each.places == NO_PLACE, NO_PLACE, moved[each.places]).astype(np.int32)
            )
            for other, each in opened.alignments.items()
            if other != number
        },
        history=(
            *opened.history,
            ChangeRecord(change="dropped", drive=name, before=opened.digest),
        ),
    )


def _routes_of(opened: Map, number: int) -> NDArray[np.intp]:
    """Return the routes that a traverse added: its places lie behind those of earlier traverses."""
    end = 0
    for earlier, record in enumerate(opened.traverses[:number]):
        if record.aligned is None:
            end += record.frames
        else:
            end = max(end, int(opened.alignments[earlier].places.max(initial=NO_PLACE)) + 1)
    shown = opened.alignments[number].places
    return np.unique(routes_of(opened.graph.first, shown[shown >= end]))


def _without_places(
    opened: Map, kept: Kept, routes: NDArray[np.intp], moved: NDArray[np.int32]
) -> Map:
    graph = _without_routes(opened.graph, routes, kept, moved)
    shrunk = change_metrics(opened, lambda metric: without_places(metric, kept, graph))
    return replace(
        shrunk,
        places=_kept_places(opened.places, kept, moved),
        local_features=opened.local_features and opened.local_features.kept(np.flatnonzero(kept)),
        channels=tuple(_without_segments(channel, kept, moved) for channel in shrunk.channels),
        graph=graph,
    )


def _kept_places(places: Places, kept: Kept, moved: NDArray[np.int32]) -> Places:
    numbers = np.flatnonzero(kept).tolist()
    thumbnails = [places.thumbnail(number) for number in numbers]
    return Places(
        stamps=places.stamps[kept],
        poses=places.poses[kept] if len(places.poses) else places.poses,
        travelled=places.travelled[kept] if len(places.travelled) else places.travelled,
        same=moved[places.same[kept]],
        thumbnails=np.frombuffer(b"".join(thumbnails), np.uint8),
        thumbnail_ends=np.cumsum([len(each) for each in thumbnails], dtype=np.int64),
    )


def _without_segments(channel: MapChannel, kept: Kept, moved: NDArray[np.int32]) -> MapChannel:
    """Return a channel without the places that are not kept, and without segments there."""
    first, last = channel.segments[:, 0], channel.segments[:, 1] - 1
    is_kept = kept[first]
    numbers = np.cumsum(np.append(0, is_kept), dtype=np.int32)
    segments = np.column_stack([moved[first], moved[last] + 1])[is_kept].astype(np.int32)
    return replace(
        channel,
        labels=numbers[channel.labels[kept]],
        segments=segments,
        scales=channel.scales[channel.scales <= np.count_nonzero(kept)],
    )


def _without_routes(
    graph: RouteGraph, routes: NDArray[np.intp], kept: Kept, moved: NDArray[np.int32]
) -> RouteGraph:
    others = np.setdiff1d(np.arange(len(graph.names)), routes)
    names = tuple(graph.names[route] for route in others)
    links = graph.links[kept[graph.links].all(axis=1)]
    return RouteGraph(names, moved[graph.first[others]], moved[links])
