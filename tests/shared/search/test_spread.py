import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.search.quantized import DESCRIPTOR_UNIT, quantize
from placefield.search.spread import deviation_from, spread_of

Quantized = NDArray[np.int16]


def some_places(count: int, seed: int, length: float = 1.0) -> Quantized:
    vectors = np.random.default_rng(seed).normal(size=(count, 12))
    vectors *= length / np.linalg.norm(vectors, axis=1, keepdims=True)
    return quantize(vectors, DESCRIPTOR_UNIT)


@pytest.mark.parametrize("count", [2, 700, 4096, 4097, 9000])
@pytest.mark.parametrize("shortest", [1.0, 0.2])
def test_the_deviation_is_that_of_the_squared_distances(count: int, shortest: float) -> None:
    places = some_places(count, seed=1)
    places[: count // 2] = some_places(count // 2, seed=2, length=shortest)
    spread = spread_of(places)
    for descriptor in some_places(5, seed=3):
        distances = ((places.astype(np.int64) - descriptor) ** 2).sum(axis=1)
        assert deviation_from(descriptor, spread) == pytest.approx(distances.std(), rel=1e-9)


def test_the_spread_is_the_covariance_of_quantized_places_and_squared_lengths() -> None:
    places = some_places(500, seed=1).astype(np.float64)
    expected = np.cov(np.column_stack([places, (places**2).sum(axis=1)]).T, bias=True)
    found = spread_of(places.astype(np.int16))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("count", [1, 3, 5000])
def test_places_that_are_all_alike_have_none(count: int) -> None:
    places = np.repeat(some_places(1, seed=1), count, axis=0)
    spread = spread_of(places)
    assert not spread.any()
    assert deviation_from(some_places(1, seed=2)[0], spread) == 0
