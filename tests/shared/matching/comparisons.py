"""Comparisons of made-up queries, for tests of what matches by them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.matching.comparing import Comparison, MetricPlaces

Array = NDArray[np.float32]


def compared(metric: MapMetric, query: Sequence[Array | None]) -> list[Comparison | None]:
    """Compare descriptors (N,) with every place exactly, one after another."""
    places = MetricPlaces(metric, exact=True)
    return [None if one is None else next(places.compare(one[None])) for one in query]


def metric_of_quantized(places: NDArray[np.int16], unit: float) -> MapMetric:
    """Make a metric of these places (K, M), as if quantized in this unit."""
    points = unit * places.astype(np.float64)
    steps = np.zeros((6, len(points)))
    for step in range(1, 7):
        if step < len(points):
            made = np.linalg.norm(points[step:] - points[:-step], axis=1)
            steps[step - 1] = made.mean()
            steps[step - 1, step:] = made
        elif step > 1:
            steps[step - 1] = steps[step - 2]
    return MapMetric(
        learned=False,
        projection=np.eye(places.shape[1], dtype=np.float32),
        unit=unit,
        places=places,
        squares=(places.astype(np.int32) ** 2).sum(axis=1, dtype=np.int32),
        steps=steps.astype(np.float32),
    )


def comparison(metric: MapMetric, descriptor: NDArray[np.int16]) -> Comparison:
    """Compare a quantized frame (M,) with the places."""
    apart = metric.places.astype(np.int32) - descriptor
    return comparison_at(metric, descriptor, (apart**2).sum(axis=1))


def comparison_at(
    metric: MapMetric, descriptor: NDArray[np.int16], distances: NDArray[np.integer]
) -> Comparison:
    """Compare a frame as if these were its distances, (K,)."""
    return Comparison(metric, descriptor, distances.astype(np.int32), float(distances.std()))
