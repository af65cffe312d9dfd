"""Metrics of a map that gains or loses places."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import projected, steps_between
from placefield.search.coarse import CoarseIndex
from placefield.search.looks import squared_lengths
from placefield.search.quantized import Quantized
from placefield.search.spread import spread_of


def with_places(metric: MapMetric, routes: list[Quantized]) -> MapMetric:
    """Return a metric with the places of further routes after its own, and without looks.

    Args:
        metric: with K places.
        routes: the quantized descriptors of each route, (n, N) int16, not projected; at least one.
    """
    added = [projected(metric, route) for route in routes]
    places = np.concatenate([metric.places, *added])
    return replace(
        metric,
        places=places,
        squares=np.concatenate([metric.squares, *map(squared_lengths, added)]),
        steps=np.concatenate(
            [metric.steps, *(steps_between(route, metric.unit) for route in added)], axis=1
        ),
        coarse=metric.coarse and _with_codes(metric.coarse, added, places),
        looks=None,
    )


def _with_codes(coarse: CoarseIndex, added: list[Quantized], places: Quantized) -> CoarseIndex:
    codes = np.concatenate([coarse.codes, *map(coarse.encode, added)])
    return replace(coarse, codes=codes, spread=spread_of(places))


def without_places(metric: MapMetric, kept: NDArray[np.bool_]) -> MapMetric:
    """Return a metric with those of its K places that are ``kept``, (K,), and without looks."""
    places, coarse = metric.places[kept], metric.coarse
    if coarse is not None:
        coarse = replace(coarse, codes=coarse.codes[kept], spread=spread_of(places))
    return replace(
        metric,
        places=places,
        squares=metric.squares[kept],
        steps=np.ascontiguousarray(metric.steps[:, kept]),
        coarse=coarse,
        looks=None,
    )
