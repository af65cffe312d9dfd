"""Metrics of a map that gains or loses places."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import projected, steps_along
from placefield.maps.route_graph import RouteGraph
from placefield.search.coarse import CoarseIndex
from placefield.search.looks import squared_lengths
from placefield.search.quantized import Quantized
from placefield.search.spread import spread_of


def with_places(metric: MapMetric, routes: list[Quantized], graph: RouteGraph) -> MapMetric:
    """Return a metric with the places of further routes after its own, and without looks.

    Args:
        metric: with K places.
        routes: the quantized descriptors of each route, (n, N) int16, not projected; at least one.
        graph: of all places.
    """
    added = [projected(metric, route) for route in routes]
    places = np.concatenate([metric.places, *added])
    return replace(
        metric,
        places=places,
        squares=np.concatenate([metric.squares, *map(squared_lengths, added)]),
        steps=steps_along(places, metric.unit, graph),
        coarse=metric.coarse and _with_codes(metric.coarse, added, places),
        looks=None,
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
    return replace(
        metric,
        places=places,
        squares=metric.squares[kept],
        steps=steps_along(places, metric.unit, graph),
        coarse=coarse,
        looks=None,
    )
