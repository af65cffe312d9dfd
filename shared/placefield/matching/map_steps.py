"""How long the steps of a map are, as the filter needs them."""

import numpy as np

from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import steps_along
from placefield.maps.topology import Topology
from placefield.matching.motion import Array, StepLengths, evenly_spaced, step_lengths

_RANDOM_PAIRS = 250  # how many random pairs are sampled


def step_lengths_of(
    metric: MapMetric, topology: Topology, *, reverse: bool, mapped: bool = False
) -> StepLengths:
    """Return how long steps are on a map, in the order of travel.

    Args:
        metric: of the whole map.
        topology: of the map, in the order of travel.
        reverse: whether this is the reverse of the map's order.
        mapped: whether they stay where they are mapped, if the order is the map's.
    """
    steps = metric.steps
    if reverse and topology.graph.is_line:
        steps = _reversed_steps(metric.steps)
    elif reverse:
        steps = steps_along(metric.places[::-1], metric.unit, topology.graph)
    steps = np.ascontiguousarray(steps) if mapped else np.array(steps)
    return step_lengths(steps, random_pairs_of(metric))


def random_pairs_of(metric: MapMetric) -> Array:
    """Return the distances of places from those half a map away, (J,) float32."""
    count = len(metric.places)
    first = evenly_spaced(np.arange(count), _RANDOM_PAIRS)
    here, there = metric.places[first], metric.places[first - count // 2]
    difference = here.astype(np.float32) - there
    return np.asarray(metric.unit * np.linalg.norm(difference, axis=1), np.float32)


def _reversed_steps(steps: Array) -> Array:
    """Return the distance of each place from those behind it, in reverse order."""
    backward = steps[:, ::-1].copy()
    for step, row in enumerate(backward, 1):
        first = min(step, len(row))
        row[first:], row[:first] = row[: len(row) - first].copy(), row[len(row) - first :].copy()
    return backward
