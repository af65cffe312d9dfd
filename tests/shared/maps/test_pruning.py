"""Looks that add nothing are not kept."""

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map_metrics import identity_metric, with_looks
from placefield.maps.pruning import MOST_LOOKS, looks_that_add
from placefield.search.quantized import DESCRIPTOR_UNIT, quantize


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


ANGLES = 0.1 * np.arange(30)
CIRCLE = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(30)])
"""Places that are 0.1 apart."""


def tilted(place: int, by: float) -> NDArray[np.float32]:
    """Return a look of a place at about this distance, away from all other places."""
    return unit((CIRCLE[place] + np.array([0, 0, by]))[None])


def adds(looks: list[tuple[int, float]], more: tuple[int, float]) -> bool:
    metric = identity_metric(CIRCLE.astype(np.float32))
    if looks:
        shown = np.array([place for place, _ in looks], np.int32)
        seen = np.concatenate([tilted(*look) for look in looks])
        of = np.ones(len(looks), np.int32)
        metric = with_looks(metric, shown, quantize(seen, DESCRIPTOR_UNIT), of)
    observed = quantize(tilted(*more), DESCRIPTOR_UNIT)
    (kept,) = looks_that_add(metric, np.array([more[0]], np.int32), observed)
    return bool(kept)


def test_a_look_adds_something_if_it_is_farther_than_neighbours_are() -> None:
    assert not adds([], (5, 0.08))
    assert adds([], (5, 0.12))
    assert not adds([(5, 0.4)], (5, 0.45))
    assert adds([(4, 0.4), (6, 0.4)], (5, 0.4))


def test_a_place_has_so_many_looks_at_most() -> None:
    known = [(5, 0.2 * number) for number in range(1, MOST_LOOKS)]
    assert adds(known, (5, -0.5))
    full = [*known, (5, 0.2 * MOST_LOOKS)]
    assert not adds(full, (5, -0.5))
    assert adds(full, (6, -0.5))
