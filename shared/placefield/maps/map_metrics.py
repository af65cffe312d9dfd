"""The metrics of a map: the places under the identity or under a learned projection."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.maps.map import STEPS, MapMetric
from placefield.search.coarse import coarse_index
from placefield.search.looks import looks_at, squared_lengths
from placefield.search.quantized import (
    DESCRIPTOR_UNIT,
    Quantized,
    QuantizedProjection,
    projected_unit,
    quantize,
)

_BLOCK = 1024  # places held as floats at once

Array = NDArray[np.float32]


def identity_metric(descriptors: Array, *, coarse: bool = False) -> MapMetric:
    """Return the identity metric with the places of these descriptors (K, N).

    With ``coarse``, it gets an index for the coarse search.
    """
    identity = np.eye(descriptors.shape[1], dtype=np.float32)
    places = np.empty(descriptors.shape, np.int16)
    for block in blocks(len(places), _BLOCK):
        places[block] = quantize(descriptors[block], DESCRIPTOR_UNIT)
    return _metric(False, identity, DESCRIPTOR_UNIT, places, coarse)


def learned_metric(projection: Array, descriptors: Array, *, coarse: bool = False) -> MapMetric:
    """Return the metric of a learned projection (M, N), see ``identity_metric``."""
    unit = projected_unit(projection)
    project = QuantizedProjection(projection, unit)
    places = np.empty((len(descriptors), len(projection)), np.int16)
    for block in blocks(len(places), _BLOCK):
        places[block] = project(quantize(descriptors[block], DESCRIPTOR_UNIT))
    return _metric(True, projection, unit, places, coarse)


def with_looks(
    metric: MapMetric,
    shown: NDArray[np.int32],
    observed: Quantized,
    traverses: NDArray[np.int32] | None = None,
) -> MapMetric:
    """Return a metric with looks of its places.

    Args:
        metric: without looks.
        shown: (L,) int32, the place of each look, ascending; at least one.
        observed: (L, N) int16, the quantized descriptors of the looks, not projected.
        traverses: (L,) int32, the number of the traverse that each is of; None if it is not known.
    """
    descriptors = projected(metric, observed)
    codes = None if metric.coarse is None else metric.coarse.encode(descriptors)
    looks = looks_at(metric.places, metric.squares, shown, descriptors, codes, traverses)
    return replace(metric, looks=looks)


def projected(metric: MapMetric, descriptors: Quantized) -> Quantized:
    """Return quantized descriptors (n, N) under a metric, (n, M) int16."""
    if not metric.learned:
        return descriptors
    project = QuantizedProjection(metric.projection, metric.unit)
    under = np.empty((len(descriptors), len(metric.projection)), np.int16)
    for block in blocks(len(descriptors), _BLOCK):
        under[block] = project(descriptors[block])
    return under


def _metric(
    learned: bool, projection: Array, unit: float, places: Quantized, coarse: bool
) -> MapMetric:
    return MapMetric(
        learned,
        projection,
        unit,
        places,
        squares=squared_lengths(places),
        steps=steps_between(places, unit),
        coarse=coarse_index(places) if coarse else None,
    )


def steps_between(places: Quantized, unit: float) -> Array:
    """Return the steps of places (K, M) in units, see ``MapMetric``: (6, K) float32."""
    steps = np.zeros((STEPS, len(places)), np.float32)
    for step, row in enumerate(steps, 1):
        for start in range(step, len(places), _BLOCK):
            arrived = places[start : start + _BLOCK].astype(np.float64)
            left = places[start - step : start - step + len(arrived)]
            row[start : start + _BLOCK] = unit * np.linalg.norm(arrived - left, axis=1)
    fill_first_steps(steps)
    return steps


def fill_first_steps(steps: Array) -> None:
    """Write the steps of places that have no place so far before them, see ``MapMetric``.

    Args:
        steps: (STEPS, K) float32; in row s, counted from 1, the first s columns are written.
    """
    count = steps.shape[1]
    for step, row in enumerate(steps, 1):
        if count > step:
            row[:step] = row[step:].mean(dtype=np.float64)
        elif step > 1:  # a map that is shorter than the step
            row[:] = steps[step - 2]
