from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.maps import map_metrics
from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import identity_metric, learned_metric

Array = NDArray[np.float32]
Make = Callable[[Array], MapMetric]


def random_walk(count: int) -> Array:
    """Unit descriptors, each near the one before it."""
    rng = np.random.default_rng(1)
    walk = rng.normal(size=20) + np.cumsum(0.3 * rng.normal(size=(count, 20)), axis=0)
    return np.asarray(walk / np.linalg.norm(walk, axis=1, keepdims=True), np.float32)


def learned_of(descriptors: Array) -> MapMetric:
    projection = np.random.default_rng(9).normal(size=(7, 20)).astype(np.float32)
    return learned_metric(projection, descriptors)


@pytest.mark.parametrize("make", [identity_metric, learned_of])
def test_places_are_the_descriptors_under_the_projection_but_for_rounding(make: Make) -> None:
    descriptors = random_walk(300)
    metric = make(descriptors)
    projection = metric.projection.astype(np.float64)
    assert metric.learned == (make is learned_of)
    assert metric.learned == (projection.shape != (20, 20))
    np.testing.assert_allclose(metric.places, descriptors @ projection.T / metric.unit, atol=3)
    squares = (metric.places.astype(np.int64) ** 2).sum(axis=1)
    assert metric.squares.tolist() == squares.tolist()
    assert (metric.places.dtype, metric.squares.dtype) == (np.int16, np.int32)


def test_without_a_projection_places_have_the_length_of_descriptors() -> None:
    metric = identity_metric(random_walk(300))
    np.testing.assert_array_equal(metric.projection, np.eye(20))
    lengths = metric.unit * np.sqrt(metric.squares)
    np.testing.assert_allclose(lengths, 1, atol=1e-3)


@pytest.mark.parametrize("scale", [1e-3, 1, 1e4])
def test_places_have_as_many_codes_whatever_the_scale_of_the_projection(scale: float) -> None:
    descriptors = random_walk(300)
    projection = np.random.default_rng(9).normal(size=(7, 20)).astype(np.float32)
    one = learned_metric(projection, descriptors)
    scaled = learned_metric(np.float32(scale) * projection, descriptors)
    assert scaled.unit == pytest.approx(scale * one.unit, rel=1e-5)
    np.testing.assert_allclose(scaled.places, one.places, atol=1)
    np.testing.assert_allclose(scaled.steps, scale * one.steps, rtol=0.02, atol=2 * scaled.unit)


@pytest.mark.parametrize("make", [identity_metric, learned_of])
@pytest.mark.parametrize("count", [1, 2, 3, 16, 17, 18, 100])
def test_steps_are_to_each_place_from_those_up_to_six_before_it(
    make: Make, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there is none before it, of mean length; on a map that is shorter, as one less."""
    monkeypatch.setattr(map_metrics, "_BLOCK", 16)
    metric = make(random_walk(count))
    points = metric.unit * metric.places.astype(np.float64)
    assert metric.steps.dtype == np.float32
    assert len(metric.steps) == 6
    shorter = np.zeros(count)
    for step, lengths in enumerate(metric.steps, 1):
        made = [float(np.linalg.norm(points[j] - points[j - step])) for j in range(step, count)]
        expected = [sum(made) / len(made)] * step + made if made else shorter
        np.testing.assert_allclose(lengths, expected, rtol=1e-6)
        shorter = lengths


@pytest.mark.parametrize("make", [identity_metric, learned_of])
def test_the_same_descriptors_make_the_same_bits(make: Make) -> None:
    one, other = make(random_walk(100)), make(random_walk(100))
    for name in ("places", "squares", "steps"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
