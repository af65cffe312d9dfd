from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placefield.search.quantized import (
    _BLOCK,
    _WORTH_BLAS,
    DESCRIPTOR_UNIT,
    LONGEST,
    Quantized,
    QuantizedProjection,
    products,
    projected_unit,
    quantize,
)

FEW_AND_MANY = [1, 2, _WORTH_BLAS - 1, _WORTH_BLAS, _WORTH_BLAS + 1, 70]
SLACK = 15  # that rounding may add to the longest, in units


def random_quantized(count: int, dimensions: int, seed: int) -> Quantized:
    """Quantized of vectors as long as a descriptor's, in all directions."""
    vectors = np.random.default_rng(seed).normal(size=(count, dimensions))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return quantize(vectors.astype(np.float32), DESCRIPTOR_UNIT)


def exact(rows: Quantized, vectors: Quantized) -> list[list[int]]:
    made: list[list[int]] = (vectors.astype(np.int64) @ rows.astype(np.int64).T).tolist()
    return made


@pytest.mark.parametrize("count", FEW_AND_MANY)
@pytest.mark.parametrize("rows", [1, _BLOCK - 1, _BLOCK, _BLOCK + 1, 2 * _BLOCK, 1000])
def test_products_are_exact(rows: int, count: int) -> None:
    places, vectors = random_quantized(rows, 50, seed=1), random_quantized(count, 50, seed=2)
    made = products(places, vectors)
    assert made.dtype == np.int32
    assert made.tolist() == exact(places, vectors)


@pytest.mark.parametrize("count", FEW_AND_MANY)
@pytest.mark.parametrize("dimensions", [1, 2, 3, 30, 300, 4096])
def test_products_of_the_longest_vectors_are_exact(dimensions: int, count: int) -> None:
    """Aligned and opposite ones, of one large value or of many equal or odd ones."""
    longest = LONGEST + SLACK
    even = np.full(dimensions, int(longest / np.sqrt(dimensions)))
    lone = np.zeros(dimensions, int)
    lone[-1] = longest
    odd = even - 1 + np.arange(dimensions) % 2
    rows = np.array([even, -even, lone, -lone, odd, -odd], np.int16)
    vectors = np.resize(rows, (count, dimensions))
    made = products(rows, vectors)
    assert made.tolist() == exact(rows, vectors)
    assert made.max() == longest**2 or count < 3


@pytest.mark.parametrize("count", FEW_AND_MANY)
def test_rows_may_be_read_only_mapped_from_a_file_or_every_other_one(
    tmp_path: Path, count: int
) -> None:
    rows, vectors = random_quantized(600, 50, seed=1), random_quantized(count, 50, seed=2)
    expected = exact(rows, vectors)
    np.save(tmp_path / "rows.npy", rows)
    mapped = np.lib.format.open_memmap(tmp_path / "rows.npy", mode="r")
    assert products(mapped, vectors).tolist() == expected
    rows.flags.writeable = vectors.flags.writeable = False
    assert products(rows, vectors).tolist() == expected
    assert products(rows[::2], vectors[:, ::-1]).tolist() == exact(rows[::2], vectors[:, ::-1])


def test_no_vectors_have_no_products() -> None:
    assert products(random_quantized(5, 50, seed=1), np.empty((0, 50), np.int16)).shape == (0, 5)


def test_quantized_values_are_the_nearest_multiples_of_their_unit() -> None:
    vectors = np.random.default_rng(1).normal(size=(40, 300))
    vectors = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)
    quantized = quantize(vectors, DESCRIPTOR_UNIT)
    assert quantized.dtype == np.int16
    np.testing.assert_allclose(quantized * DESCRIPTOR_UNIT, vectors, atol=0.501 * DESCRIPTOR_UNIT)
    np.testing.assert_array_equal(quantize(vectors[3], DESCRIPTOR_UNIT), quantized[3])
    lengths = np.linalg.norm(quantized.astype(np.float64), axis=1)
    assert np.all(lengths <= LONGEST + SLACK)


@st.composite
def projections(draw: st.DrawFn) -> np.ndarray:
    rows, columns = draw(st.integers(1, 40)), draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    spread = draw(st.sampled_from([1, 1e3, 1e6]))
    size = draw(st.sampled_from([1e-6, 1, 1e6]))
    values = size * np.geomspace(1, spread, rows)[:, None] * rng.normal(size=(rows, columns))
    return values.astype(np.float32)


@given(projections(), st.integers(0, 99), st.lists(st.integers(0, 60), max_size=4).map(sorted))
@settings(max_examples=60)
def test_a_projection_of_many_is_that_of_each_to_the_last_bit(
    projection: np.ndarray, seed: int, splits: list[int]
) -> None:
    project = QuantizedProjection(projection, projected_unit(projection))
    descriptors = random_quantized(60, projection.shape[1], seed)
    alone = np.concatenate([project(one[None]) for one in descriptors])
    batched = np.concatenate([project(batch) for batch in np.split(descriptors, splits)])
    assert alone.dtype == batched.dtype == np.int16
    np.testing.assert_array_equal(alone, batched)


@given(projections(), st.integers(0, 99))
def test_a_projection_is_the_exact_one_but_for_rounding(projection: np.ndarray, seed: int) -> None:
    unit = projected_unit(projection)
    descriptors = random_quantized(20, projection.shape[1], seed)
    projected = QuantizedProjection(projection, unit)(descriptors)
    expected = DESCRIPTOR_UNIT * descriptors @ projection.T.astype(np.float64) / unit
    # Of each of the N products of a row, half a code of its factor is rounded off, at most.
    rows, columns = projection.shape
    assert np.abs(projected - expected).max() <= 0.51 + 0.51 * np.sqrt(columns)
    lengths = np.linalg.norm(projected.astype(np.float64), axis=1)
    assert np.all(lengths <= LONGEST + SLACK + np.sqrt(rows * columns))


@given(projections())
def test_the_longest_vector_of_a_projection_has_the_greatest_length(
    projection: np.ndarray,
) -> None:
    """The descriptor that it stretches the most, and the one that is reversed around."""
    _, _, directions = np.linalg.svd(projection.astype(np.float64))
    longest = quantize(directions[:1].astype(np.float32), DESCRIPTOR_UNIT)
    project = QuantizedProjection(projection, projected_unit(projection))
    for descriptor in (longest, -longest):
        projected = project(descriptor).astype(np.int64)
        length = np.linalg.norm(projected)
        assert 0.98 * LONGEST <= length <= LONGEST + 4 * SLACK
        assert products(project(descriptor), project(descriptor)).item() == (projected**2).sum()
