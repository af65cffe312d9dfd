"""Joins maps to one map with the routes of all.

A map keeps descriptors, not features, and each map has principal axes of its own. So features are
restored from the descriptors along the axes, and a map is built of them, as of traverses. Restored
features lack only what the axes of their map do not keep.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np

from placefield.config import BuildConfig, Config
from placefield.errors import MapError
from placefield.features.descriptors import DescriptorModel
from placefield.maps.joining_routes import GivenLink, join_routes
from placefield.maps.look_rows import identity_of, look_rows
from placefield.maps.map import Array, Map, MapAlignment, MapMetric
from placefield.maps.map_metrics import change_metrics
from placefield.maps.traverse import NO_PLACE, ROUTE, Alignment, Traverse
from placefield.search.quantized import DESCRIPTOR_UNIT, Quantized
from placefield.verification.place_features import PlaceFeatures


def check_joinable(one: Map, other: Map) -> None:
    """Refuse two maps that cannot be joined.

    Raises:
        MapError: one is of an earlier version, or their descriptors are of different features,
            decodings, views or masks.
    """
    for each in (one, other):
        _identity_of(each)
    if _feature_of(one) != _feature_of(other):
        raise MapError(
            f"its features are {_words(other)}, and those of the first map {_words(one)}: build "
            "one map of all frames with 'placefield build --routes'"
        )
    if _least_sides_of(one) != _least_sides_of(other):
        raise MapError(
            "its images are decoded to another size than those of the first map: build both with "
            "one version of placefield"
        )
    if one.model.view != other.model.view:
        raise MapError(
            "its view is not that of the first map: build both with the same --camera and "
            "--query-camera"
        )
    if _mask_of(one) != _mask_of(other):
        raise MapError("its mask is not that of the first map: build both with the same --mask")
    views = one.local_features, other.local_features
    if views[0] and views[1] and _network_of(views[0]) != _network_of(views[1]):
        raise MapError(
            "its local features are of another kind than those of the first map: build both with "
            "the same build.local_feature"
        )


def traverses_of(
    maps: Sequence[Map], links: Sequence[GivenLink] = (), *, same_frame: bool = False
) -> list[Traverse]:
    """Return the traverses that the joined map is built of.

    The first has the places of all maps; the others have the looks that each further traverse of a
    map gave.

    Args:
        maps: two or more, each with its identity metric.
        links: between places of their routes, besides their own.
        same_frame: see ``join_routes``.

    Raises:
        MapError: see ``join_routes``.
    """
    starts = accumulate((opened.places.count for opened in maps), initial=0)
    looks = [
        traverse
        for opened, start in zip(maps, starts, strict=False)
        for traverse in _looks_of(opened, start)
    ]
    return [join_routes(list(map(_places_of, maps)), links, same_frame=same_frame), *looks]


def config_of(maps: Sequence[Map]) -> Config:
    """Return the configuration of the joined map: that of the first one, with looks if any has."""
    first = maps[0]
    dimensions = max(opened.features.dimensions or 0 for opened in maps)
    return Config(
        preset=first.preset,
        seed=first.seed,
        features=first.features.model_copy(update={"dimensions": dimensions or None}),
        scales=first.scales,
        metric=first.metric,
        build=BuildConfig(looks=any(_identity_of(opened).looks is not None for opened in maps)),
    )


def with_records(built: Map, maps: Sequence[Map]) -> Map:
    """Return the joined map with the records and alignments of the maps' traverses."""
    alignments = {}
    numbers = list(range(len(built.graph.names)))  # in the joined map, of the traverses built of
    place, number = 0, 0
    for opened in maps:
        for own, alignment in opened.alignments.items():
            moved = np.where(alignment.places == NO_PLACE, NO_PLACE, alignment.places + place)
            alignments[number + own] = MapAlignment(moved.astype(np.int32))
        numbers += [number + own for own in _seen_by(opened)]
        place, number = place + opened.places.count, number + len(opened.traverses)
    numbered = np.array(numbers, np.int32)

    def renumbered(metric: MapMetric) -> MapMetric:
        looks = metric.looks
        if looks is None or looks.traverses is None:
            return metric
        return replace(metric, looks=replace(looks, traverses=numbered[looks.traverses]))

    return replace(
        change_metrics(built, renumbered),
        traverses=tuple(record for opened in maps for record in opened.traverses),
        alignments=alignments,
    )


def _places_of(opened: Map) -> Traverse:
    places, views = opened.places, opened.local_features
    return Traverse(
        ", ".join(opened.graph.names),
        _restored(opened, _identity_of(opened).places),
        places.stamps,
        places.poses,
        places.travelled,
        tuple(places.thumbnail(place) for place in range(places.count)),
        opened.pose_frame or ROUTE,
        () if views is None else tuple(map(views.of, range(places.count))),
        None if views is None else views.onnx,
        graph=opened.graph,
    )


def _looks_of(opened: Map, start: int) -> list[Traverse]:
    """Return the looks that each further traverse gave; ``start`` is the map's first place."""
    rows = look_rows(_identity_of(opened))
    traverses = []
    for number in _seen_by(opened):
        own = rows.chosen(rows.traverses == number)
        record, count = opened.traverses[number], len(own.places)
        certain = np.ones(count, np.float32)
        alignment = Alignment(own.places + np.int32(start), certain, record.by or "number")
        traverses.append(
            Traverse(
                record.name,
                _restored(opened, own.observed),
                np.zeros(count, np.int64),
                np.empty((0, 3)),
                np.empty(0),
                (),
                alignment=alignment,
            )
        )
    return traverses


def _seen_by(opened: Map) -> list[int]:
    """Return the numbers of the traverses that gave looks, ascending."""
    return [int(number) for number in np.unique(look_rows(_identity_of(opened)).traverses)]


def _restored(opened: Map, descriptors: Quantized) -> Array:
    return opened.model.restored(descriptors * np.float32(DESCRIPTOR_UNIT))


def _identity_of(opened: Map) -> MapMetric:
    return identity_of(opened, "it cannot be joined")


def _feature_of(opened: Map) -> tuple[object, ...]:
    """Return what must be equal in maps that are joined."""
    model = opened.model
    return model.standardise, model.plain, *map(_part, model.parts)


def _part(model: DescriptorModel) -> tuple[str, bytes | None, int]:
    network = None if model.network is None else model.network.digest
    return model.kind if network is None else "network", network, model.raw_dimensions


def _least_sides_of(opened: Map) -> list[int | None]:
    return [part.least_side for part in opened.model.parts]


def _mask_of(opened: Map) -> tuple[tuple[int, ...], bytes] | None:
    mask = opened.model.mask
    return None if mask is None else (mask.used.shape, mask.used.tobytes())


def _network_of(views: PlaceFeatures) -> bytes | None:
    return None if views.onnx is None else views.onnx.tobytes()


def _words(opened: Map) -> str:
    model = opened.model
    made = "plain PCA" if model.plain else "standardised" if model.standardise else "as they are"
    return f"{model.kind}, {made}"
