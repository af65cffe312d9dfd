"""The metrics of a map: the places under the identity or under a learned projection."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.maps.map import STEPS, Map, MapMetric
from placefield.maps.route_graph import RouteGraph
from placefield.search.coarse import CoarseIndex, coarse_index
from placefield.search.inverted import inverted_lists
from placefield.search.looks import looks_at, squared_lengths
from placefield.search.quantized import (
    DESCRIPTOR_UNIT,
    Quantized,
    QuantizedProjection,
    projected_unit,
    quantize,
)
from placefield.search.spread import spread_of

_BLOCK = 1024  # places held as floats at once

Array = NDArray[np.float32]


def identity_metric(descriptors: Array, *, coarse: bool = False) -> MapMetric:
    """Return the identity metric with the places of these descriptors (K, N).

    With ``coarse``, it gets an index for the coarse search.
    """
    places = np.empty(descriptors.shape, np.int16)
    for block in blocks(len(places), _BLOCK):
        places[block] = quantize(descriptors[block], DESCRIPTOR_UNIT)
    return identity_of_quantized(places, coarse=coarse)


def identity_of_quantized(places: Quantized, *, coarse: bool = False) -> MapMetric:
    """Return the identity metric with these quantized places (K, N), see ``identity_metric``.

    They may be mapped from a file; no copy of all of them is made.
    """
    identity = np.eye(places.shape[1], dtype=np.float32)
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
    """Return a metric with these looks of its places, and none of its own.

    Args:
        metric: of the places.
        shown: (L,) int32, the place of each look, ascending; at least one.
        observed: (L, N) int16, the quantized descriptors of the looks, not projected.
        traverses: (L,) int32, the number of the traverse that each is of; None if it is not known.
    """
    descriptors = projected(metric, observed)
    codes = None if metric.coarse is None else metric.coarse.encode(descriptors)
    looks = looks_at(metric.places, metric.squares, shown, descriptors, codes, traverses)
    return _listed(replace(metric, looks=looks))


def without_looks(metric: MapMetric) -> MapMetric:
    """Return a metric without looks of its places."""
    return metric if metric.looks is None else _listed(replace(metric, looks=None))


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
    return _listed(
        MapMetric(
            learned,
            projection,
            unit,
            places,
            squares=squared_lengths(places),
            steps=steps_along(places, unit, RouteGraph.line("")),
            coarse=coarse_index(places) if coarse else None,
        )
    )


def _listed(metric: MapMetric) -> MapMetric:
    """Return a metric with the inverted lists of its coarse index, if it has one."""
    coarse, looks = metric.coarse, metric.looks
    if coarse is None:
        return metric
    codes, squares = coarse.codes, metric.squares
    places = np.arange(len(codes), dtype=np.int32)
    if looks is not None and looks.codes is not None:
        codes = np.concatenate([codes, looks.codes])
        squares = np.concatenate([squares, looks.squares])
        places = np.concatenate([places, looks.places])
        squares += looks.biases[places]
    return replace(metric, coarse=replace(coarse, lists=inverted_lists(codes, places, squares)))


def steps_along(places: Quantized, unit: float, graph: RouteGraph) -> Array:
    """Return the steps of a metric with these places on a graph, see ``MapMetric``."""
    count = len(places)
    steps, known = np.zeros((STEPS, count), np.float32), np.zeros((STEPS, count), np.bool_)
    before = graph.before(count)
    left = np.arange(count, dtype=np.int32)
    for step in range(STEPS):
        left = np.where(left < 0, left, before[left])
        known[step] = left >= 0
        arrived = np.flatnonzero(known[step])
        for block in blocks(len(arrived), _BLOCK):
            some = arrived[block]
            apart = places[some].astype(np.float64) - places[left[some]]
            steps[step, some] = unit * np.linalg.norm(apart, axis=1)
    fill_steps(steps, known)
    return steps


def fill_steps(steps: Array, known: NDArray[np.bool_]) -> None:
    """Write the steps of places that have no place so far before them, see ``MapMetric``.

    Args:
        steps: (STEPS, K) float32.
        known: (STEPS, K), which steps are known; the others are written.
    """
    for step, (row, ours) in enumerate(zip(steps, known, strict=True)):
        if ours.any():
            row[~ours] = row[ours].mean(dtype=np.float64)
        elif step > 0:  # no place is so far from the first one of its route
            row[:] = steps[step - 1]


def with_places(metric: MapMetric, routes: list[Quantized], graph: RouteGraph) -> MapMetric:
    """Return a metric with the places of further routes after its own, and without looks.

    Args:
        metric: with K places.
        routes: the quantized descriptors of each route, (n, N) int16, not projected; at least one.
        graph: of all places.
    """
    added = [projected(metric, route) for route in routes]
    places = np.concatenate([metric.places, *added])
    return _listed(
        replace(
            metric,
            places=places,
            squares=np.concatenate([metric.squares, *map(squared_lengths, added)]),
            steps=steps_along(places, metric.unit, graph),
            coarse=metric.coarse and _with_codes(metric.coarse, added, places),
            looks=None,
        )
    )


def _with_codes(coarse: CoarseIndex, added: list[Quantized], places: Quantized) -> CoarseIndex:
    codes = np.concatenate([coarse.codes, *map(coarse.encode, added)])
    return replace(coarse, codes=codes, spread=spread_of(places))


def without_places(metric: MapMetric, kept: NDArray[np.bool_], graph: RouteGraph) -> MapMetric:
    """Return a metric with some of its K places, and without looks.

    Args:
        metric: with K places.
        kept: (K,) bool, which of them stay.
        graph: of those that stay.
    """
    places, coarse = metric.places[kept], metric.coarse
    if coarse is not None:
        coarse = replace(coarse, codes=coarse.codes[kept], spread=spread_of(places))
    return _listed(
        replace(
            metric,
            places=places,
            squares=metric.squares[kept],
            steps=steps_along(places, metric.unit, graph),
            coarse=coarse,
            looks=None,
        )
    )


def change_metrics(opened: Map, change: Callable[[MapMetric], MapMetric]) -> Map:
    """Return a map with each of its metrics changed; channels that shared one still do."""
    changed = {metric: change(metric) for metric in opened.metrics}
    return replace(
        opened,
        identity=None if opened.identity is None else changed[opened.identity],
        channels=tuple(
            replace(channel, metric=changed[channel.metric]) for channel in opened.channels
        ),
    )


def with_graph(opened: Map, graph: RouteGraph) -> Map:
    """Return a map with another graph of its places, so that its steps follow the graph."""

    def along(metric: MapMetric) -> MapMetric:
        return replace(metric, steps=steps_along(metric.places, metric.unit, graph))

    return replace(change_metrics(opened, along), graph=graph)
