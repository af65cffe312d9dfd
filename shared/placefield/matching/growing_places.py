"""The places of a map that grows along a drive, and how long steps on it are."""

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import STEPS, MapMetric
from placefield.maps.map_metrics import fill_steps
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.map_steps import random_pairs_of
from placefield.matching.motion import Array, StepLengths, step_lengths
from placefield.search.quantized import DESCRIPTOR_UNIT, quantize

_FIRST = 256  # places that there is room for at first; the room doubles


class GrowingPlaces:
    """The places so far, under the identity metric.

    Adding a place takes the same time and memory whatever their number, on average.
    """

    def __init__(self, dimensions: int) -> None:
        """Begin without places; their descriptors are (N,)."""
        self._identity = np.eye(dimensions, dtype=np.float32)
        self._places = np.empty((_FIRST, dimensions), np.int16)
        self._squares = np.empty(_FIRST, np.int32)
        self._steps = np.zeros((STEPS, _FIRST), np.float32)
        self.count = 0
        """Number of places."""

    def add(self, descriptor: Array) -> None:
        """Append the place of a descriptor (N,) float32, of length 1."""
        if self.count == len(self._places):
            self._places = np.concatenate([self._places, np.empty_like(self._places)])
            self._squares = np.concatenate([self._squares, np.empty_like(self._squares)])
            self._steps = np.concatenate([self._steps, np.zeros_like(self._steps)], axis=1)
        place = quantize(descriptor, DESCRIPTOR_UNIT)
        before = self._places[max(self.count - STEPS, 0) : self.count][::-1].astype(np.float32)
        steps = DESCRIPTOR_UNIT * np.linalg.norm(before - place, axis=1)
        self._steps[: len(steps), self.count] = steps
        self._places[self.count] = place
        self._squares[self.count] = np.dot(place.astype(np.int32), place)
        self.count += 1

    def first(self, count: int) -> MapMetric:
        """Return the metric of the first ``count`` places; it stays as it is when others follow."""
        steps = self._steps[:, :count].copy()
        fill_steps(steps, np.arange(count) >= np.arange(1, STEPS + 1)[:, None])
        places, squares = self._places[:count], self._squares[:count]
        return MapMetric(False, self._identity, DESCRIPTOR_UNIT, places, squares, steps)


def lengths_of(metric: MapMetric) -> StepLengths:
    """Return how long steps are on a map whose steps may change."""
    return step_lengths(metric.steps, random_pairs_of(metric))


def compare(metric: MapMetric, descriptor: NDArray[np.float32]) -> Comparison:
    """Compare a descriptor (N,) with every place of a metric."""
    return next(MetricPlaces(metric, exact=True).compare(descriptor[None]))
