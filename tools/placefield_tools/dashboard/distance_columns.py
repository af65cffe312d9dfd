"""Distances from a frame to all places of a map, in at most 400 columns."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import Map
from placefield.matching.comparing import MetricPlaces

_MOST_COLUMNS = 400
_MOST_PLACES = 4096  # a frame is compared with at most so many places, evenly spaced

Row = NDArray[np.float32]


class DistanceColumns:
    """Compares descriptors with the places of a map, in the first channel's metric."""

    def __init__(self, placemap: Map) -> None:
        metric = placemap.channels[0].metric
        every_nth = np.arange(0, len(metric.places), -(-len(metric.places) // _MOST_PLACES))
        some = replace(
            metric,
            places=metric.places[every_nth],
            squares=metric.squares[every_nth],
            coarse=None,
            looks=metric.looks and metric.looks.of(every_nth),
        )
        count = len(some.places)
        self.count = min(count, _MOST_COLUMNS)
        self._starts = np.arange(self.count) * count // self.count
        self._unit = metric.unit
        self._places = MetricPlaces(some, exact=True)
        self.row(
            np.zeros(metric.projection.shape[1], np.float32)
        )  # the first comparison allocates and compiles

    def row(self, descriptor: Row) -> Row:
        """Return squared distances, (count,): the smallest of each column's places."""
        [compared] = self._places.compare(descriptor[None])
        nearest = np.minimum.reduceat(compared.distances, self._starts)
        return np.asarray(nearest * self._unit**2, np.float32)
