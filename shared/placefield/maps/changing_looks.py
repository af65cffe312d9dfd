"""The looks of a map's places, in all of its metrics."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import Map, MapMetric
from placefield.maps.map_metrics import with_looks, with_metrics
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


def look_rows(identity: MapMetric) -> LookRows:
    """Return the looks of a map by its identity metric; their traverses must be known."""
    looks = identity.looks
    if looks is None or looks.traverses is None:
        none = np.empty(0, np.int32)
        return LookRows(none, np.empty((0, identity.places.shape[1]), np.int16), none)
    return LookRows(looks.places, looks.descriptors, looks.traverses)


def joined(one: LookRows, other: LookRows) -> LookRows:
    """Return all looks of both; at each place, those of ``one`` come first."""
    both = LookRows(
        np.concatenate([one.places, other.places]),
        np.concatenate([one.observed, other.observed]),
        np.concatenate([one.traverses, other.traverses]),
    )
    return both.chosen(np.argsort(both.places, kind="stable"))


def with_rows(opened: Map, rows: LookRows) -> Map:
    """Return a map whose metrics have these looks, and no others."""

    def change(metric: MapMetric) -> MapMetric:
        alone = replace(metric, looks=None)
        return with_looks(alone, *rows) if len(rows.places) else alone

    return with_metrics(opened, change)
