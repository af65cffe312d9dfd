"""Distances of query frames to every place, under a metric (Eqs. 5 to 7)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.kernels import kernel, sum_of
from placefield.maps.map import MapMetric
from placefield.search.looks import Looks
from placefield.search.quantized import (
    DESCRIPTOR_UNIT,
    Quantized,
    QuantizedProjection,
    product_of,
    products,
    quantize,
)

_AT_ONCE = 2**22  # distances held at once
_RERANKED = 64  # about one of so many places is re-ranked after the coarse search
_SAMPLE = 2**14  # size of the sample of places that gives their greatest distance


Distances = NDArray[np.int32]


@dataclass(frozen=True)
class Comparison:
    """The distances of a query frame to the places.

    Attributes:
        metric: that they are under.
        descriptor: (M,) int16, of the frame, quantized.
        distances: (K,) int32, squared distance to each place, ||v x - v r_j||², in squared units of
            the metric; if a place has looks, see ``Looks``.
        deviation: standard deviation of the exact distances to the places without their looks.
        is_exact: whether all distances are exact; else only those to the nearest places are.
        is_reversed: whether the places are in reverse order.
        along: (R,) int16, the frame along the axes of the inverted lists, if these are used:
            ``distances`` is empty then, and those that are needed are computed by
            ``distances_to``; else None.
    """

    metric: MapMetric
    descriptor: Quantized
    distances: Distances
    deviation: float
    is_exact: bool = True
    is_reversed: bool = False
    along: Quantized | None = None

    def reversed(self) -> "Comparison":
        """Return this comparison with the places in reverse order."""
        distances = np.ascontiguousarray(self.distances[::-1])
        return replace(self, distances=distances, is_reversed=not self.is_reversed)

    def reranked(self, places: NDArray[np.int32]) -> "Comparison":
        """Return this comparison with the exact distances to some places, (n,)."""
        if self.is_reversed:
            return self.reversed().reranked(len(self.distances) - 1 - places).reversed()
        distances = self.distances.copy()
        distances[places] = _measured(self.metric, self.descriptor, places)
        return replace(self, distances=distances)

    def distances_to(self, places: NDArray[np.int32]) -> Distances:
        """Return the exact squared distances to some places, (n,)."""
        if self.is_reversed:
            places = np.int32(len(self.metric.places) - 1) - places
        return _measured(self.metric, self.descriptor, places)

    def nearest(self, lists: int, most: int) -> NDArray[np.int32]:
        """Return the nearest places that the inverted lists have, see ``InvertedLists.nearest``."""
        coarse = self.metric.coarse
        assert self.along is not None
        assert coarse is not None
        assert coarse.lists is not None
        places = coarse.lists.nearest(self.along, coarse.unit, lists, most)
        if self.is_reversed:
            return np.int32(len(self.metric.places) - 1) - places[::-1]
        return places


class MetricPlaces:
    """Compares descriptors with the places of a map under one of its metrics.

    All streams and all channels of the metric may share it.
    """

    def __init__(self, metric: MapMetric, *, exact: bool) -> None:
        """Prepare for a metric. Its places are read where they are mapped.

        Args:
            metric: of a map.
            exact: whether to compare with every place exactly, even if the map has a coarse index.
        """
        self._metric = metric
        self._project = (
            QuantizedProjection(metric.projection, metric.unit) if metric.learned else None
        )
        self._project_coarsely: QuantizedProjection | None = None
        if metric.coarse is not None and not exact:
            self._project_coarsely = QuantizedProjection(metric.coarse.axes, DESCRIPTOR_UNIT)

    def compare(self, descriptors: NDArray[np.float32]) -> Iterator[Comparison]:
        """Compare descriptors (B, N), of length 1; yield one comparison each, in order.

        A comparison does not depend on the other descriptors, to the last bit.
        """
        quantized = quantize(descriptors, DESCRIPTOR_UNIT)
        if self._project is not None:
            quantized = self._project(quantized)
        looks = self._metric.looks
        rows = len(self._metric.places) + (0 if looks is None else len(looks.places))
        at_once = max(1, _AT_ONCE // rows)
        compare = self._exactly
        if self._project_coarsely is not None:
            compare = self._by_lists if has_lists(self._metric) else self._coarsely
        for some in blocks(len(quantized), at_once):
            yield from compare(quantized[some])

    def _exactly(self, descriptors: Quantized) -> Iterator[Comparison]:
        metric = self._metric
        distances = products(metric.places, descriptors)
        looks = metric.looks
        looked = None if looks is None else products(looks.descriptors, descriptors)
        deviations = _to_all_distances(distances, metric.squares, descriptors).tolist()
        for number, (vector, row) in enumerate(zip(descriptors, distances, strict=True)):
            if looks is not None and looked is not None:
                _lower(looked[number], 1.0, looks, vector, row)
            yield Comparison(metric, vector, row, deviations[number])

    def _coarsely(self, descriptors: Quantized) -> Iterator[Comparison]:
        metric, coarse, project_coarsely = self._metric, self._metric.coarse, self._project_coarsely
        assert coarse is not None
        assert project_coarsely is not None
        coarsely = project_coarsely(descriptors)
        distances, looks = products(coarse.codes, coarsely), metric.looks
        looked = None if looks is None or looks.codes is None else products(looks.codes, coarsely)
        for number, (vector, row) in enumerate(zip(descriptors, distances, strict=True)):
            _to_distances(row, coarse.unit, metric.squares, vector)
            if looks is not None and looked is not None:
                _lower(looked[number], coarse.unit, looks, vector, row)
            near = np.flatnonzero(row <= _nearness(row)).astype(np.int32)
            row[near] = _measured(metric, vector, near)
            yield Comparison(metric, vector, row, coarse.deviation(vector), is_exact=False)

    def _by_lists(self, descriptors: Quantized) -> Iterator[Comparison]:
        metric, coarse, project_coarsely = self._metric, self._metric.coarse, self._project_coarsely
        assert coarse is not None
        assert project_coarsely is not None
        nothing = np.empty(0, np.int32)
        for vector, along in zip(descriptors, project_coarsely(descriptors), strict=True):
            deviation = coarse.deviation(vector)
            yield Comparison(metric, vector, nothing, deviation, is_exact=False, along=along)


class SampledPlaces:
    """Compares frames with a sample of a map's places and with the neighbours of these.

    The sample represents the whole map in a shard, and where distances are not exact.
    """

    def __init__(self, metric: MapMetric, chosen: NDArray[np.int32]) -> None:
        """Prepare the chosen places, (n,), of a metric of the whole map."""
        last = len(metric.places) - 1
        around = np.clip(np.add.outer(chosen, (-1, 0, 1)), 0, last).ravel()
        self._places = np.ascontiguousarray(metric.places[around])
        self._squares = np.ascontiguousarray(metric.squares[around])
        self._looks = metric.looks and metric.looks.of(around)

    def distances(self, descriptor: Quantized) -> Distances:
        """Return the squared distances of a frame (M,) to each place and its neighbours, (n, 3)."""
        (row,) = products(self._places, descriptor[None])
        _to_distances(row, 1.0, self._squares, descriptor)
        if self._looks is not None:
            (looked,) = products(self._looks.descriptors, descriptor[None])
            _lower(looked, 1.0, self._looks, descriptor, row)
        return np.asarray(row.reshape(-1, 3))

    def nearness(self, descriptor: Quantized) -> Distances:
        """Return the nearness of a frame (M,) to each place, (n,), see ``evidence_kernels``."""
        around = self.distances(descriptor)
        return np.asarray(around[:, 1] + around.min(axis=1))


def has_lists(metric: MapMetric) -> bool:
    """Whether a metric has inverted lists, see ``CoarseIndex``."""
    return metric.coarse is not None and metric.coarse.lists is not None


def _lower(
    products: Distances, unit: float, looks: Looks, descriptor: Quantized, distances: Distances
) -> None:
    """Turn the distances of places, (K,), into those with their looks and biases.

    Args:
        products: (L,) of the looks with the descriptor, times the unit; receives the distances.
        unit: of the products.
        looks: of the places.
        descriptor: (M,) of the frame.
        distances: (K,) of the places.
    """
    _to_distances(products, unit, looks.squares, descriptor)
    _to_least(looks.places, products, distances)
    distances += looks.biases


@kernel
def _to_least(places: NDArray[np.int32], looked: Distances, distances: Distances) -> None:
    for look in range(len(looked)):
        distances[places[look]] = min(distances[places[look]], looked[look])


def _nearness(distances: Distances) -> np.int32:
    """Return the distance within which about one of ``_RERANKED`` places is."""
    sample = distances[:: -(-len(distances) // _SAMPLE)]
    nearest = len(sample) // _RERANKED
    return np.int32(np.partition(sample, nearest)[nearest])


@kernel
def _to_distances(
    products: Distances, unit: float, place_squares: NDArray[np.int32], descriptor: Quantized
) -> None:
    """Turn products of places with a vector, times a unit, into squared distances."""
    square = product_of(descriptor, descriptor)
    for place in range(len(products)):
        product = np.int32(unit * products[place])
        products[place] = np.int32(place_squares[place] + square - 2 * product)


@kernel
def _to_all_distances(
    products: Distances, place_squares: NDArray[np.int32], descriptors: Quantized
) -> NDArray[np.float64]:
    """Turn products, (B, K), into squared distances, and return their standard deviations, (B,)."""
    deviations = np.empty(len(products))
    for b in range(len(products)):
        _to_distances(products[b], 1.0, place_squares, descriptors[b])
        deviations[b] = _deviation(products[b])
    return deviations


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


def _measured(metric: MapMetric, descriptor: Quantized, chosen: NDArray[np.int32]) -> Distances:
    """Return the exact squared distances to the chosen places, (n,)."""
    distances = _measured_rows(metric.places, metric.squares, descriptor, chosen)
    looks = metric.looks
    if looks is not None:
        at, rows = looks.rows_of(chosen)
        _to_least(at, _measured_rows(looks.descriptors, looks.squares, descriptor, rows), distances)
        distances += looks.biases[chosen]
    return distances


@kernel
def _measured_rows(
    rows: Quantized, squares: NDArray[np.int32], descriptor: Quantized, chosen: NDArray[np.int32]
) -> Distances:
    """Return the exact squared distances to the chosen rows, (n,)."""
    distances = np.empty(len(chosen), np.int32)
    square = product_of(descriptor, descriptor)
    for i in range(len(chosen)):
        product = product_of(rows[chosen[i]], descriptor)
        distances[i] = squares[chosen[i]] + square - 2 * product
    return distances


def distance_matrix(
    metric: MapMetric, descriptors: Sequence[NDArray[np.float32] | None], unobserved: float
) -> NDArray[np.float32]:
    """Compare a whole query, (N,) each, with the places: (Q, K) float32, squared distances.

    Missing observations, None, have ``unobserved`` for every place.
    """
    matrix = np.full((len(descriptors), len(metric.places)), unobserved, np.float32)
    observed = [number for number, descriptor in enumerate(descriptors) if descriptor is not None]
    if observed:
        stacked = np.stack([one for one in descriptors if one is not None])
        frames = MetricPlaces(metric, exact=True).compare(stacked)
        for number, frame in zip(observed, frames, strict=True):
            matrix[number] = frame.distances * metric.unit**2
    return matrix
