"""Appends routes to a map: the stretches of a drive that it does not have."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.config import ScaleConfig
from placefield.errors import MapError
from placefield.maps.changing_looks import with_metrics
from placefield.maps.growing_metrics import with_places
from placefield.maps.map import Map, MapChannel, Places
from placefield.maps.route_graph import RouteGraph
from placefield.maps.stretches import Stretch
from placefield.maps.traverse import NO_PLACE, Traverse
from placefield.scales.channels import make_channels
from placefield.scales.encoding import Encoding
from placefield.search.quantized import DESCRIPTOR_UNIT, Quantized
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

    Args:
        opened: the map, with its identity.
        traverse: the drive of F frames; its poses are in the map's coordinate frame.
        stretches: of the drive; at least one.
        descriptors: (F, N) int16, the quantized descriptors of the drive.
    """
    routes = [descriptors[stretch.frames] for stretch in stretches]
    encoded = [_cut(opened, route) for route in routes]
    grown = with_metrics(opened, lambda metric: with_places(metric, routes))
    channels = zip(grown.channels, *encoded, strict=True)
    return replace(
        grown,
        places=_with_frames(opened.places, traverse, [each.frames for each in stretches]),
        local_features=_with_views(opened.local_features, traverse, stretches),
        channels=tuple(_with_segments(channel, added) for channel, *added in channels),
        graph=_with_stretches(opened.graph, traverse.name, stretches, opened.places.count),
    )


def _cut(opened: Map, route: Quantized) -> list[Encoding]:
    """Cut a route into the segments of each channel, by the map's settings, lengths in frames.

    A route that is too short for them has no segment. The rule ``filter`` needs none.
    """
    scales: ScaleConfig = opened.scales
    try:
        channels = make_channels(
            (route * DESCRIPTOR_UNIT).astype(np.float32),
            channels=len(opened.channels),
            clusters=scales.clusters,
            fuzzifiers=scales.fuzzifiers,
            same_start=scales.same_start,
            position_weight=scales.position_weight,
            min_scale=opened.channels[0].smallest,
            seed=opened.seed,
        )
    except MapError:
        none = np.empty((0, 2), np.int32)
        inactive = Encoding(np.zeros(len(route), np.int32), none, np.empty(0, np.int32))
        return [inactive] * len(opened.channels)
    return [channel.encoding for channel in channels]


def _with_segments(channel: MapChannel, added: Sequence[Encoding]) -> MapChannel:
    labels, segments = channel.labels, channel.segments
    for each in added:
        moved = each.segments + np.int32(len(labels))
        numbers = np.where(each.labels > 0, each.labels + np.int32(len(segments)), 0)
        labels = np.concatenate([labels, numbers.astype(np.int32)])
        segments = np.concatenate([segments, moved])
    scales = [channel.scales, *(each.scales for each in added)]
    return replace(
        channel, labels=labels, segments=segments, scales=np.unique(np.concatenate(scales))
    )


def _with_frames(places: Places, traverse: Traverse, routes: Sequence[Numbers]) -> Places:
    frames, count = np.concatenate(routes), places.count
    thumbnails = [traverse.thumbnails[frame] for frame in frames.tolist()]
    start = places.thumbnail_ends[-1]
    lengths = np.array([len(thumbnail) for thumbnail in thumbnails], np.int64)
    return Places(
        stamps=np.concatenate([places.stamps, traverse.stamps[frames]]),
        poses=_with_poses(places.poses, traverse.poses, frames),
        travelled=_with_metres(places.travelled, traverse.travelled, routes),
        same=np.append(places.same, np.arange(count, count + len(frames), dtype=np.int32)),
        thumbnails=np.concatenate([places.thumbnails, np.frombuffer(b"".join(thumbnails), "u1")]),
        thumbnail_ends=np.concatenate([places.thumbnail_ends, start + np.cumsum(lengths)]),
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
    graph: RouteGraph, name: str, stretches: Sequence[Stretch], count: int
) -> RouteGraph:
    """Append a route for each stretch, with links from the place before and to the one after."""
    first, links = graph.first.tolist(), {(one, other) for one, other in graph.links.tolist()}
    for stretch in stretches:
        last = count + len(stretch.frames) - 1
        if stretch.before != NO_PLACE:
            links.add((stretch.before, count))
        if stretch.after != NO_PLACE:
            links.add((last, stretch.after))
        first.append(count)
        count = last + 1
    return RouteGraph(
        (*graph.names, *[name] * len(stretches)),
        np.array(first, np.int32),
        np.array(sorted(links), np.int32).reshape(-1, 2),
    )
