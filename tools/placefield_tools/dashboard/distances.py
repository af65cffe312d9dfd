"""How far a frame is from all places of a map, in as many columns as can be seen."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import Map
from placefield.matching.comparing import MetricPlaces

_MOST_COLUMNS = 400
_MOST_PLACES = 4096  # that a frame is compared with; of a larger map, evenly spaced ones

Row = NDArray[np.float32]


class DistanceColumns:
    """Compares descriptors with the places of a map, under its first channel's metric."""

    def __init__(self, placemap: Map) -> None:
        metric = placemap.channels[0].metric
        spaced = slice(None, None, -(-len(metric.places) // _MOST_PLACES))
        some = replace(
            metric,
            places=np.ascontiguousarray(metric.places[spaced]),
            squares=np.ascontiguousarray(metric.squares[spaced]),
            coarse=None,
        )
        count = len(some.places)
        self.count = min(count, _MOST_COLUMNS)
        self._starts = np.arange(self.count) * count // self.count
        self._unit = metric.unit
        self._places = MetricPlaces(some, exact=True)
        self.row(
            np.zeros(metric.projection.shape[1], np.float32)
        )  # what is made at its first use is made

    def row(self, descriptor: Row) -> Row:
        """Return squared distances, (count,): each column's is of the nearest of its places."""
        [compared] = self._places.compare(descriptor[None])
        nearest = np.minimum.reduceat(compared.distances, self._starts)
        return np.asarray(nearest * self._unit**2, np.float32)
