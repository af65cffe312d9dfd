"""Distances of query frames to every place, under a metric (Eqs. 5 to 7)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.kernels import kernel, sum_of
from placefield.maps.map import MapMetric
from placefield.search.quantized import (
    DESCRIPTOR_UNIT,
    CodedProjection,
    Codes,
    codes_of,
    product_of,
    products,
)

_AT_ONCE = 2**22  # distances held at once
_LOOKED_AT = 64  # one of so many places is near enough at the coarse look for an exact one
_SAMPLE = 2**14  # places that tell how near that is


Distances = NDArray[np.int32]


@dataclass(frozen=True)
class Comparison:
    """A query frame beside the places.

    Attributes:
        metric: under which.
        codes: (M,) int16, the frame's descriptor.
        distances: (K,) int32, squared distance to each place, ||v x - v r_j||², in squared units of
            the metric.
        deviation: standard deviation of the exact distances.
        is_exact: whether they are; else those to the nearest places are.
        is_turned: whether the places are in reverse order.
    """

    metric: MapMetric
    codes: Codes
    distances: Distances
    deviation: float
    is_exact: bool = True
    is_turned: bool = False

    def turned(self) -> "Comparison":
        """Return this comparison with the places in reverse order."""
        distances = np.ascontiguousarray(self.distances[::-1])
        return replace(self, distances=distances, is_turned=not self.is_turned)

    def made_exact(self, places: NDArray[np.int32]) -> "Comparison":
        """Return this comparison with the exact distances to some places."""
        if self.is_turned:
            return self.turned().made_exact(len(self.distances) - 1 - places).turned()
        distances = self.distances.copy()
        _measure(self.metric.places, self.metric.squares, self.codes, places, distances)
        return replace(self, distances=distances)


class MetricPlaces:
    """Compares descriptors with the places of a map under one of its metrics.

    All streams and all channels of the metric may share it.
    """

    def __init__(self, metric: MapMetric, *, exact: bool) -> None:
        """Take the metric and its places, which are read where they are mapped.

        Args:
            metric: of a map.
            exact: whether to compare with every place exactly also if the map has a coarse look.
        """
        self._metric = metric
        self._project = CodedProjection(metric.projection, metric.unit) if metric.learned else None
        self._look_along: CodedProjection | None = None
        if metric.coarse is not None and not exact:
            self._look_along = CodedProjection(metric.coarse.axes, DESCRIPTOR_UNIT)

    def compare(self, descriptors: NDArray[np.float32]) -> Iterator[Comparison]:
        """Compare descriptors (B, N), of length 1; one comparison each, in order.

        What comes of a descriptor does not depend on the others, to the last bit.
        """
        codes = codes_of(descriptors, DESCRIPTOR_UNIT)
        if self._project is not None:
            codes = self._project(codes)
        at_once = max(1, _AT_ONCE // len(self._metric.places))
        compare = self._coarsely if self._look_along else self._exactly
        for some in blocks(len(codes), at_once):
            yield from compare(codes[some])

    def _exactly(self, codes: Codes) -> Iterator[Comparison]:
        metric = self._metric
        distances = products(metric.places, codes)
        for vector, row in zip(codes, distances, strict=True):
            _to_distances(row, 1.0, metric.squares, vector)
            yield Comparison(metric, vector, row, _deviation(row))

    def _coarsely(self, codes: Codes) -> Iterator[Comparison]:
        metric, look, look_along = self._metric, self._metric.coarse, self._look_along
        assert look is not None
        assert look_along is not None
        distances = products(look.codes, look_along(codes))
        for vector, row in zip(codes, distances, strict=True):
            _to_distances(row, look.unit, metric.squares, vector)
            near = np.flatnonzero(row <= _nearness(row)).astype(np.int32)
            _measure(metric.places, metric.squares, vector, near, row)
            yield Comparison(metric, vector, row, look.deviation(vector), is_exact=False)


class SomePlaces:
    """Compares frames with some of a map's places, that stand for all, and with their neighbours.

    Who has a shard of the map alone, or distances that are not exact, knows all of it by these.
    """

    def __init__(self, metric: MapMetric, chosen: NDArray[np.int32]) -> None:
        """Take the chosen places, (n,), of a metric of the whole map."""
        last = len(metric.places) - 1
        around = np.clip(np.add.outer(chosen, (-1, 0, 1)), 0, last).ravel()
        self._places = np.ascontiguousarray(metric.places[around])
        self._squares = np.ascontiguousarray(metric.squares[around])

    def distances(self, codes: Codes) -> Distances:
        """Squared distances of a frame (M,) to each one's neighbour, itself, neighbour, (n, 3)."""
        (row,) = products(self._places, codes[None])
        _to_distances(row, 1.0, self._squares, codes)
        return np.asarray(row.reshape(-1, 3))


def _nearness(distances: Distances) -> np.int32:
    """Return the distance that about one of ``_LOOKED_AT`` places is within."""
    sample = distances[:: -(-len(distances) // _SAMPLE)]
    nearest = len(sample) // _LOOKED_AT
    return np.int32(np.partition(sample, nearest)[nearest])


@kernel
def _to_distances(
    products: Distances, unit: float, place_squares: NDArray[np.int32], codes: Codes
) -> None:
    """Turn products of places with a vector, times a unit, into distances."""
    square = product_of(codes, codes)
    for place in range(len(products)):
        product = np.int32(unit * products[place])
        products[place] = np.int32(place_squares[place] + square - 2 * product)


@kernel
def _deviation(distances: Distances) -> float:
    total = 0
    for distance in distances:
        total += int(distance)
    mean = total / len(distances)
    squares = np.empty(len(distances))
    for place in range(len(distances)):
        squares[place] = (distances[place] - mean) * (distances[place] - mean)
    return math.sqrt(sum_of(squares) / len(distances))


@kernel
def _measure(
    places: Codes,
    place_squares: NDArray[np.int32],
    codes: Codes,
    chosen: NDArray[np.int32],
    distances: Distances,
) -> None:
    """Write the exact distances to the chosen places."""
    square = product_of(codes, codes)
    for i in range(len(chosen)):
        product = product_of(places[chosen[i]], codes)
        distances[chosen[i]] = place_squares[chosen[i]] + square - 2 * product


def distance_matrix(
    metric: MapMetric, descriptors: Sequence[NDArray[np.float32] | None], unobserved: float
) -> NDArray[np.float32]:
    """Compare a whole query, (N,) each, with the places: (Q, K) float32, of squared descriptors.

    Frames that were not observed, None, have ``unobserved`` for every place.
    """
    matrix = np.full((len(descriptors), len(metric.places)), unobserved, np.float32)
    observed = [number for number, descriptor in enumerate(descriptors) if descriptor is not None]
    if observed:
        stacked = np.stack([one for one in descriptors if one is not None])
        frames = MetricPlaces(metric, exact=True).compare(stacked)
        for number, frame in zip(observed, frames, strict=True):
            matrix[number] = frame.distances * metric.unit**2
    return matrix
