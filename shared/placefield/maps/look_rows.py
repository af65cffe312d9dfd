"""The looks of a map's places, in all of its metrics."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.manifest import REBUILD
from placefield.maps.map import Map, MapMetric
from placefield.maps.map_metrics import change_metrics, with_looks, without_looks
from placefield.search.quantized import Quantized


class LookRows(NamedTuple):
    """Looks before they are projected.

    Attributes:
        places: (L,) int32, the place of each, ascending.
        observed: (L, N) int16, their quantized descriptors.
        traverses: (L,) int32, the number of the traverse of each.
    """

    places: NDArray[np.int32]
    observed: Quantized
    traverses: NDArray[np.int32]

    def chosen(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "LookRows":
        """Return some of them."""
        return LookRows(self.places[rows], self.observed[rows], self.traverses[rows])


def identity_of(opened: Map, refused: str) -> MapMetric:
    """Return the identity metric of a map, if the traverse of each of its looks is known.

    Args:
        opened: the map, with all its channels.
        refused: what cannot be done otherwise, for the error.

    Raises:
        MapError: an earlier version built the map.
    """
    identity = opened.identity
    if identity is None or (identity.looks is not None and identity.looks.traverses is None):
        raise MapError(f"an earlier version built it, so {refused}; {REBUILD}")
    return identity


def look_rows(identity: MapMetric) -> LookRows:
    """Return the looks of a map by its identity metric; their traverses must be known."""
    looks = identity.looks
    if looks is None or looks.traverses is None:
        none = np.empty(0, np.int32)
        return LookRows(none, np.empty((0, identity.places.shape[1]), np.int16), none)
    return LookRows(looks.places, looks.descriptors, looks.traverses)


def merged(one: LookRows, other: LookRows) -> LookRows:
    """Return all looks of both; at each place, those of ``one`` come first."""
    both = LookRows(
        np.concatenate([one.places, other.places]),
        np.concatenate([one.observed, other.observed]),
        np.concatenate([one.traverses, other.traverses]),
    )
    return both.chosen(np.argsort(both.places, kind="stable"))


def replace_looks(opened: Map, rows: LookRows) -> Map:
    """Return a map whose metrics have these looks, and none of their own."""

    def change(metric: MapMetric) -> MapMetric:
        return with_looks(metric, *rows) if len(rows.places) else without_looks(metric)

    return change_metrics(opened, change)
