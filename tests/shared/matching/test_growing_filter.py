"""A filter whose map grows, against one of the whole map."""

import numpy as np
from comparisons import comparison, metric_of_quantized
from filters import filter_of

from placefield.matching.best_window import Vicinity
from placefield.matching.filter_matcher import FilterMatcher, WholeMap
from placefield.matching.growing_places import lengths_of
from placefield.matching.smoother import Smoother
from placefield.search.quantized import DESCRIPTOR_UNIT, quantize


def test_places_that_are_added_before_the_first_frame_are_as_good_as_there_from_the_start() -> None:
    views = np.random.default_rng(0).normal(size=(60, 20))
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    places = quantize(views, DESCRIPTOR_UNIT)
    metric = metric_of_quantized(places, DESCRIPTOR_UNIT)
    first = lengths_of(metric_of_quantized(places[:5], DESCRIPTOR_UNIT))
    smoother = Smoother(first, 1000, Vicinity(3))
    grown = FilterMatcher(WholeMap(first, None, None), slice(0, 5), 0, [smoother])
    grown.grow(lengths_of(metric), Vicinity(3))
    # A filter begins anywhere on the map that it was made for: both forget it.
    grown._filter.forget()
    whole = filter_of(metric, lag=1000)
    for place in range(10, 40):
        frame = comparison(metric, places[place])
        expected = whole.update(frame)
        grown.local(frame)
        candidate = grown.reduce(())
        assert candidate.place == expected.place
        np.testing.assert_array_equal(candidate.places, expected.places)
        np.testing.assert_allclose(candidate.evidence, expected.evidence, rtol=1e-5)
    for one, other in zip(grown.finish(), whole.finish(), strict=True):
        np.testing.assert_allclose(one.candidate.evidence, other.candidate.evidence, rtol=1e-4)


def test_a_place_that_joins_the_map_is_recognised_at_once() -> None:
    views = np.random.default_rng(0).normal(size=(60, 20))
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    places = quantize(views, DESCRIPTOR_UNIT)
    first = metric_of_quantized(places[:40], DESCRIPTOR_UNIT)
    lengths = lengths_of(first)
    smoother = Smoother(lengths, 1000, Vicinity(3))
    matcher = FilterMatcher(WholeMap(lengths, None, None), slice(0, 40), 0, [smoother])
    found = []
    for place in range(20, 60):
        metric = metric_of_quantized(places[: max(place + 1, 40)], DESCRIPTOR_UNIT)
        if place >= 40:
            matcher.grow(lengths_of(metric), Vicinity(3))
        matcher.local(comparison(metric, places[place]))
        found.append(matcher.reduce(()).place)
    assert found[5:] == [*range(25, 60)]
