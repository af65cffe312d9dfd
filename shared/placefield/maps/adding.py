"""Adds a drive to a map: further looks of its places, and the stretches that it does not have.

The descriptor model and the learned projections of the map stay as they are. New places are the
last ones of the map, so the numbers of the others stay.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.features.descriptors import is_blank
from placefield.maps.appending_routes import takes_places, with_routes
from placefield.maps.gathering import looks_of
from placefield.maps.look_rows import identity_of, look_rows, merged, replace_looks
from placefield.maps.manifest import ChangeRecord, TraverseRecord
from placefield.maps.map import Map, MapAlignment, MapMetric
from placefield.maps.pruning import looks_that_add
from placefield.maps.route_distances import RouteDistances
from placefield.maps.same_route import align_to_map, poses_in_map
from placefield.maps.stretches import LEAST_FRAMES, Stretch, new_stretches, unknown_runs
from placefield.maps.traverse import NO_PLACE, Alignment, Traverse, content_of
from placefield.matching.comparing import MetricPlaces
from placefield.search.quantized import DESCRIPTOR_UNIT, quantize

_LEAST_STEP = 0.5  # typical steps from place to place: a slow drive has fewer places than frames

Array = NDArray[np.float32]
Numbers = NDArray[np.intp]


class Addition(NamedTuple):
    """A map with one drive more, and what the drive added.

    Attributes:
        map: the new map.
        looks: the number of new looks.
        pruned: the number of looks that would have added nothing.
        places: the number of new places.
        left_out: the number of frames of new stretches that cannot be places, because the places of
            the map have metres travelled, and the drive has none.
    """

    map: Map
    looks: int
    pruned: int
    places: int
    left_out: int


def check_growable(opened: Map) -> MapMetric:
    """Return the identity metric of a map that drives can be added to, or dropped from.

    Raises:
        MapError: the map is of an earlier version, or has descriptors of plain PCA.
    """
    if opened.model.plain:
        raise MapError(
            "has descriptors of plain PCA (features.plain_pca), which no drive can be aligned by; "
            "build the map without"
        )
    return identity_of(opened, "its drives cannot be changed")


def check_name(opened: Map, name: str) -> None:
    """Refuse a name that a drive of the map has.

    Raises:
        MapError: the name is taken.
    """
    if any(record.is_named(name) for record in opened.traverses):
        raise MapError(
            f"{name}: the map has a drive of this name; drop that one first, or give this one "
            "another name with --name"
        )


def check_content(opened: Map, name: str, content: str) -> None:
    """Refuse a drive whose frames the map has, also under another name.

    Args:
        opened: the map.
        name: of the drive.
        content: of the drive, see ``content_of``.

    Raises:
        MapError: a drive of the map has the same content.
    """
    for record in opened.traverses:
        if record.content == content:
            raise MapError(
                f"{name}: the map has this drive, as {record.name}: the frames are the same; give "
                "another drive"
            )


def add_traverse(opened: Map, traverse: Traverse) -> Addition:
    """Add a drive to a map.

    Args:
        opened: the map, with all its channels.
        traverse: the drive, with raw features of the map's kind; its alignment is not used.

    Raises:
        MapError: see ``check_growable``; or the map has a drive of this name; or the drive does not
            show the route.
    """
    identity = check_growable(opened)
    check_name(opened, traverse.name)
    descriptors = opened.model.of_traverse(traverse.raw)
    traverse = replace(traverse, poses=poses_in_map(opened.pose_frame, traverse))
    alignment = align_to_map(opened, identity, traverse, descriptors)
    is_clear = np.array([not is_blank(raw) for raw in traverse.raw])
    stretches = _stretches(opened, alignment, descriptors, traverse.poses, is_clear)
    left_out = 0
    if not takes_places(opened.places, traverse):
        stretches, left_out = [], sum(len(stretch.frames) for stretch in stretches)
    quantized = quantize(descriptors, DESCRIPTOR_UNIT)
    shown = alignment.shown()
    shown = shown[is_clear[shown]]
    seen = looks_of(
        quantized[shown],
        alignment.places[shown],
        len(opened.traverses),
        opened.places.count,
        opened.graph.first,
    )
    adds = looks_that_add(identity, seen.places, seen.observed)
    grown = with_routes(opened, traverse, stretches, quantized) if stretches else opened
    grown = _recorded(grown, opened, traverse, alignment, stretches)
    return Addition(
        replace_looks(grown, merged(look_rows(identity), seen.chosen(adds))),
        looks=int(adds.sum()),
        pruned=int((~adds).sum()),
        places=grown.places.count - opened.places.count,
        left_out=left_out,
    )


def _stretches(
    opened: Map,
    alignment: Alignment,
    descriptors: Array,
    poses: NDArray[np.float64],
    is_clear: NDArray[np.bool_],
) -> list[Stretch]:
    longest = max((stop - start for start, stop in unknown_runs(alignment.places)), default=0)
    if longest < LEAST_FRAMES:
        return []
    identity, is_usable = check_growable(opened), is_clear
    if alignment.by == "poses":
        is_usable = is_clear & np.isfinite(poses).all(axis=1)
    compared = MetricPlaces(identity, exact=True).compare(descriptors)
    nearest = np.array([frame.distances.argmin() for frame in compared], np.int32)
    distinct = _distinct(descriptors, alignment, is_usable, identity)
    return new_stretches(
        alignment, distinct, nearest, RouteDistances(opened.graph, opened.places.count)
    )


def _distinct(
    descriptors: Array, alignment: Alignment, is_usable: NDArray[np.bool_], identity: MapMetric
) -> Numbers:
    """Return the numbers of usable frames that are half a typical step apart at least, ascending.

    The typical step is that from place to place, as this drive shows the places of the map.
    """
    shown = alignment.shown()
    is_next = np.diff(alignment.places[shown]) == 1
    steps = np.linalg.norm(np.diff(descriptors[shown], axis=0)[is_next], axis=1)
    typical = float(np.median(steps if len(steps) else identity.steps[0]))
    distinct: list[int] = []
    for frame in np.flatnonzero(is_usable).tolist():
        last = descriptors[distinct[-1]] if distinct else None
        if last is None or np.linalg.norm(descriptors[frame] - last) >= _LEAST_STEP * typical:
            distinct.append(frame)
    return np.array(distinct, np.intp)


def _recorded(
    grown: Map, opened: Map, traverse: Traverse, alignment: Alignment, stretches: list[Stretch]
) -> Map:
    """Return the map with the drive's record and alignment, and with the change in its history."""
    places, count = alignment.places.copy(), opened.places.count
    for stretch in stretches:
        places[stretch.frames] = np.arange(count, count + len(stretch.frames))
        count += len(stretch.frames)
    record = TraverseRecord(
        name=traverse.name,
        frames=len(places),
        aligned=int(np.count_nonzero(places != NO_PLACE)),
        by=alignment.by,
        content=content_of(traverse.raw),
    )
    change = ChangeRecord(change="added", drive=traverse.name, before=opened.digest)
    return replace(
        grown,
        traverses=(*opened.traverses, record),
        alignments={**opened.alignments, len(opened.traverses): MapAlignment(places)},
        history=(*opened.history, change),
    )
