"""Gathers the frames of several traverses of one route by the places that they show."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.alignment import align_by_number
from placefield.maps.look_rows import LookRows, merged
from placefield.maps.manifest import TraverseRecord
from placefield.maps.route_graph import ONE_ROUTE, Firsts, routes_of
from placefield.maps.traverse import Alignment, Traverse, content_of
from placefield.metric.gate import Probes
from placefield.search.quantized import DESCRIPTOR_UNIT, Quantized, quantize
from placefield.verification.learning import features_of_places
from placefield.verification.place_features import PlaceFeatures

_NEAR = 3
"""Places within which a frame of one place is a look of another, without a frame of its own."""

Array = NDArray[np.float32]


def alignment_of(traverse: Traverse, first: Traverse) -> Alignment:
    """Return a traverse's alignment to the first; without one, frame i shows place i.

    Raises:
        MapError: the traverse has no alignment, and its number of frames differs from the first's.
    """
    if traverse.alignment is not None:
        return traverse.alignment
    if len(traverse.raw) != len(first.raw):
        raise MapError(
            f"{traverse.name} has {len(traverse.raw)} frames and {first.name} {len(first.raw)}, "
            "and they are not aligned; parts of one drive take --one-drive"
        )
    return align_by_number(len(traverse.raw))


def chosen_rows(raw: Array, frames: NDArray[np.intp]) -> Array:
    """Return the raw features (F, D) of the chosen frames; no copy is made if all are chosen."""
    return raw if len(frames) == len(raw) else raw[frames]


def records_of(
    traverses: Sequence[Traverse], alignments: Sequence[Alignment]
) -> tuple[TraverseRecord, ...]:
    """Return the records of the traverses for a map, each route of the first one by itself.

    The first traverse has no alignment.
    """
    first, graph = traverses[0], traverses[0].routes
    routes = zip(graph.names, np.split(first.raw, graph.first[1:]), strict=True)
    others = zip(traverses[1:], alignments[1:], strict=True)
    return (
        *(
            TraverseRecord(name=name, frames=len(raw), content=content_of(raw))
            for name, raw in routes
        ),
        *(
            TraverseRecord(
                name=each.name,
                frames=len(each.raw),
                aligned=to.aligned,
                by=to.by,
                content=content_of(each.raw),
            )
            for each, to in others
        ),
    )


def trained_first(
    held_back: NDArray[np.bool_], place_of: Sequence[NDArray[np.int32]]
) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Order the frames of all stacked traverses so that those of held-back places come last.

    Args:
        held_back: (K,) bool, whether each place is held back.
        place_of: of each traverse, (F,) int32, the place that each of its frames shows.

    Returns:
        The order, and the place of each frame in this order.
    """
    places = np.concatenate(place_of)
    order = np.argsort(held_back[places], kind="stable")
    return order, places[order]


def centred(descriptors: Sequence[Array], order: NDArray[np.intp]) -> Array:
    """Stack the descriptors (F, N) of all traverses, reorder them and subtract their mean."""
    reference = np.concatenate(descriptors)[order]
    reference -= reference.mean(axis=0)
    return reference


def looks_of_others(
    descriptors: Sequence[Array], place_of: Sequence[NDArray[np.int32]], first: Firsts
) -> LookRows:
    """Return the looks that all traverses but the first give.

    Args:
        descriptors: of each traverse, (F, N) float32; the first's are the places.
        place_of: of each traverse, (F,) int32, the place that each of its frames shows.
        first: (R,) int32, the first place of each route; each route has a record of its own.
    """
    count, dimensions = descriptors[0].shape
    none = np.empty(0, np.int32)
    looks = LookRows(none, np.empty((0, dimensions), np.int16), none)
    others = zip(descriptors[1:], place_of[1:], strict=True)
    for number, (each, shown) in enumerate(others, len(first)):
        observed = quantize(each, DESCRIPTOR_UNIT)
        looks = merged(looks, looks_of(observed, shown, number, count, first))
    return looks


def looks_of(
    observed: Quantized, shown: NDArray[np.int32], number: int, count: int, first: Firsts
) -> LookRows:
    """Return the looks that a traverse gives, one of each place at most.

    A place that no frame shows has the frame of the nearest place, if that is at most 3 places
    away: a faster traverse has no frame of every place, and the first frames of a traverse are
    often not aligned.

    Args:
        observed: (F, N) int16, quantized descriptors of frames that show a place.
        shown: (F,) int32, the place that each of them shows.
        number: of the traverse.
        count: the number of places.
        first: (R,) int32, the first place of each route.
    """
    places, frames = nearest_frames(shown, count, first)
    return LookRows(places, observed[frames], np.full(len(places), number, np.int32))


def nearest_frames(
    shown: NDArray[np.int32], count: int, first: Firsts = ONE_ROUTE
) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Return the places near those that frames show, (F,), and the nearest frame of each.

    Args:
        shown: (F,) int32, the place that each frame shows.
        count: the number of places.
        first: (R,) int32, the first place of each route; a frame of one shows no place of another.
    """
    if not len(shown):
        return np.empty(0, np.int32), np.empty(0, np.intp)
    order = np.argsort(shown, kind="stable")
    all_places = np.arange(count, dtype=np.int32)
    after = np.searchsorted(shown[order], all_places).clip(max=len(shown) - 1)
    before = (after - 1).clip(min=0)
    apart = [np.abs(shown[order[each]] - all_places) for each in (before, after)]
    nearest = np.where(apart[0] <= apart[1], before, after)
    is_near = np.minimum(*apart) <= _NEAR
    is_near &= routes_of(first, shown[order[nearest]]) == routes_of(first, all_places)
    return all_places[is_near], order[nearest[is_near]]


def local_features_of(
    traverses: Sequence[Traverse],
    place_of: Sequence[NDArray[np.int32]],
    shown: Sequence[NDArray[np.intp]],
    same: NDArray[np.int32],
    seed: int,
) -> PlaceFeatures | None:
    """Return the local features of the places; None if the traverses have none.

    Args:
        traverses: the first one's frames are the places.
        place_of: of each traverse, (F,) int32, the place that each of its chosen frames shows.
        shown: of each traverse, (F,), the numbers of its chosen frames.
        same: (K,) int32, see ``Places``.
        seed: of the choice of pairs that are compared.
    """
    if not traverses[0].local_features:
        return None
    again = [
        (int(place), traverse.local_features[frame])
        for traverse, places, frames in zip(traverses[1:], place_of[1:], shown[1:], strict=True)
        if traverse.local_features
        for place, frame in zip(places, frames, strict=True)
    ]
    found = features_of_places(traverses[0].local_features, again, same, seed)
    return found and replace(found, onnx=traverses[0].local_network)


def probes_of(
    descriptors: Sequence[Array],
    place_of: Sequence[NDArray[np.int32]],
    held_back: NDArray[np.bool_],
) -> Probes | None:
    """Return the gate's probes: the held-back places as the other traverses observed them.

    With one traverse there are none.

    Args:
        descriptors: of each traverse, (F, N) float32; the first's are the places.
        place_of: of each traverse, (F,) int32, the place that each of its frames shows.
        held_back: (K,) bool, whether each place is held back.
    """
    first, *others = descriptors
    if not others:
        return None
    asked = [held_back[places] for places in place_of[1:]]
    return Probes(
        first,
        np.concatenate([other[rows] for other, rows in zip(others, asked, strict=True)]),
        np.concatenate([places[rows] for places, rows in zip(place_of[1:], asked, strict=True)]),
    )
