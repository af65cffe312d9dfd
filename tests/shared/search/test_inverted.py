"""Inverted lists, beside a search of all codes."""

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.maps.map_metrics import identity_metric, with_looks, without_looks
from placefield.search.coarse import CoarseIndex
from placefield.search.inverted import InvertedLists, distinct, inverted_lists, least_of
from placefield.search.quantized import DESCRIPTOR_UNIT, QuantizedProjection, quantize

Array = NDArray[np.float32]
COUNT, DIMENSIONS = 5000, 100


def walk(count: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    made = np.zeros((count, DIMENSIONS))
    spread = 1 / np.sqrt(1 + np.arange(DIMENSIONS) / 5)
    for place in range(count):
        made[place] = 0.9 * made[place - 1] + spread * rng.normal(size=DIMENSIONS)
    return np.asarray(made / np.linalg.norm(made, axis=1, keepdims=True), np.float32)


PLACES = walk(COUNT)
METRIC = identity_metric(PLACES, coarse=True)


def index_of(metric: MapMetric) -> tuple[CoarseIndex, InvertedLists]:
    assert metric.coarse is not None
    assert metric.coarse.lists is not None
    return metric.coarse, metric.coarse.lists


def along(index: CoarseIndex, frames: Array) -> NDArray[np.int16]:
    return QuantizedProjection(index.axes, DESCRIPTOR_UNIT)(quantize(frames, DESCRIPTOR_UNIT))


def brute_force(metric: MapMetric, frame: NDArray[np.int16], most: int) -> set[int]:
    """The nearest places by their codes."""
    index, _ = index_of(metric)
    near = metric.squares - 2 * index.unit * (index.codes.astype(np.int64) @ frame)
    return set(np.argsort(near, kind="stable")[:most].tolist())


def test_each_code_is_in_the_list_of_its_nearest_centroid() -> None:
    index, lists = index_of(METRIC)
    assert len(lists.centroids) == 70  # the root of the number of places
    assert sorted(lists.places.tolist()) == list(range(COUNT))
    np.testing.assert_array_equal(lists.codes, index.codes[lists.places])
    np.testing.assert_array_equal(lists.squares, METRIC.squares[lists.places])
    apart = lists.codes[:, None].astype(np.int64) - lists.centroids
    nearest = (apart**2).sum(axis=2).argmin(axis=1)
    np.testing.assert_array_equal(np.searchsorted(lists.ends, np.arange(COUNT), "right"), nearest)


def test_in_all_lists_the_nearest_places_are_those_of_a_search_of_all_codes() -> None:
    index, lists = index_of(METRIC)
    for frame in along(index, walk(20, seed=1)):
        found = lists.nearest(frame, index.unit, lists=len(lists.ends), most=50)
        assert np.all(np.diff(found) > 0)
        assert len(found) == 50
        assert len(brute_force(METRIC, frame, 50) & set(found.tolist())) >= 49  # but for rounding


def test_in_the_nearest_lists_are_most_of_the_nearest_places() -> None:
    index, lists = index_of(METRIC)
    noise = np.random.default_rng(2).normal(size=(200, DIMENSIONS)) / DIMENSIONS**0.5
    shown = np.arange(0, COUNT, 25)
    frames = (PLACES[shown] + 0.8 * noise).astype(np.float32)
    recalled = []
    for lists_read in (4, 16, 35):
        found = [
            lists.nearest(frame, index.unit, lists_read, 256) for frame in along(index, frames)
        ]
        recalled.append(np.mean([place in each for place, each in zip(shown, found, strict=True)]))
    assert recalled == sorted(recalled)
    assert recalled[0] > 0.5  # at random it would be 4 of 70
    assert recalled[2] > 0.95


def test_looks_are_found_as_their_places() -> None:
    shown = np.array([7, 7, 2500], np.int32)
    looks = walk(3, seed=3)
    metric = with_looks(METRIC, shown, quantize(looks, DESCRIPTOR_UNIT))
    index, lists = index_of(metric)
    assert len(lists.places) == COUNT + 3
    for place, frame in zip(shown, along(index, looks), strict=True):
        assert place in lists.nearest(frame, index.unit, lists=5, most=3)
    _, alone = index_of(without_looks(metric))
    for one, other in zip(alone, index_of(METRIC)[1], strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_beginning_has_the_rows_of_the_first_places() -> None:
    _, lists = index_of(METRIC)
    beginning = lists.beginning(100)
    assert sorted(beginning.places.tolist()) == list(range(100))
    begins = np.append(0, beginning.ends[:-1])
    for number, (begin, end) in enumerate(zip(begins, beginning.ends, strict=True)):
        whole = lists.places[lists.ends[number - 1] if number else 0 : lists.ends[number]]
        assert beginning.places[begin:end].tolist() == whole[whole < 100].tolist()


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_codes_and_equal_ones_are_in_lists_too(count: int) -> None:
    codes, numbers = np.ones((count, 3), np.int8), np.arange(count, dtype=np.int32)
    lists = inverted_lists(codes, numbers, np.full(count, 3, np.int32))
    found = lists.nearest(np.ones(3, np.int16), 1.0, lists=1, most=10)
    assert found.tolist() == list(range(count))


def test_of_equal_values_the_first_are_least() -> None:
    values = np.array([5, 1, 3, 3, 0, 3], np.int32)
    assert least_of(values, 3).tolist() == [1, 2, 4]
    assert least_of(values, 9).tolist() == list(range(6))
    assert distinct(values).tolist() == [0, 1, 3, 5]
    assert distinct(values[:0]).tolist() == []
