from dataclasses import fields

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from placefield.metric.gate import TOLERANCE, Margins, Probes, margins, passes_gate, probe_score

IGNORES_WEATHER = np.diag(np.repeat([1, 0.1], 4)).astype(np.float32)
SEES_WEATHER = np.diag(np.repeat([0.1, 1], 4)).astype(np.float32)


def made_probes(count=40):
    """A route that four dimensions tell the places of; four more hold the weather of each frame."""
    rng = np.random.default_rng(0)
    place = gaussian_filter1d(rng.normal(size=(60, 4)), 2, axis=0)
    places = np.hstack([place / place.std(), 1.5 * rng.normal(size=(60, 4))])
    truth = rng.choice(60, count, replace=False)
    descriptors = places[truth] + 0.1 * rng.normal(size=(count, 8))
    descriptors[:, 4:] = 1.5 * rng.normal(size=(count, 4))
    return Probes(places.astype(np.float32), descriptors.astype(np.float32), truth)


def literal_margins(projection, frame, truth, places, without=None):
    """Contrast and standardised margin of one frame."""
    found = {
        place: float(((projection @ (descriptor - frame)) ** 2).sum())
        for place, descriptor in enumerate(places)
        if place != without
    }
    right = min(d for place, d in found.items() if abs(place - truth) <= TOLERANCE)
    wrong = min(d for place, d in found.items() if abs(place - truth) > TOLERANCE)
    return (wrong - right) / (wrong + right), (wrong - right) / np.std(list(found.values()))


def test_margins_are_the_literal_ones_and_the_score_a_mean_of_them():
    probes = made_probes()
    projection = np.random.default_rng(2).normal(size=(5, 8)).astype(np.float32)
    found = margins(projection, probes)
    expected = np.array(
        [
            literal_margins(projection, frame, truth, probes.places)
            for frame, truth in zip(probes.descriptors, probes.truth, strict=True)
        ]
    )
    np.testing.assert_allclose(found.contrast, expected[:, 0], atol=1e-4)
    np.testing.assert_allclose(found.standardised, expected[:, 1], atol=1e-4)
    own = [
        literal_margins(projection, probes.places[place], place, probes.places, without=place)[0]
        for place in sorted(probes.truth)
    ]
    np.testing.assert_allclose(found.own_contrast, own, atol=1e-4)
    assert probe_score(projection, probes) == pytest.approx(expected[:, 1].mean(), abs=1e-4)


def test_no_projection_is_the_identity_at_any_scale():
    probes = made_probes()
    plain = margins(None, probes)
    scaled = margins(np.float32(64) * np.eye(8, dtype=np.float32), probes)
    for field in fields(Margins):
        expected = getattr(plain, field.name)
        np.testing.assert_allclose(getattr(scaled, field.name), expected, atol=1e-4)


@pytest.mark.parametrize("count", [2 * TOLERANCE, 30])
def test_margins_are_zero_where_nothing_tells_places_apart_or_none_is_wrong(count):
    alike = Probes(np.ones((count, 2), np.float32), np.ones((1, 2), np.float32), np.array([4]))
    found = margins(None, alike)
    for field in fields(Margins):
        assert getattr(found, field.name).tolist() == [0.0]


def test_a_metric_that_ignores_the_weather_passes_and_one_that_sees_nothing_else_does_not():
    probes = made_probes()
    assert passes_gate(IGNORES_WEATHER, probes)
    assert not passes_gate(SEES_WEATHER, probes)


def test_a_metric_fitted_to_the_other_traverse_at_the_cost_of_its_own_is_refused():
    """Where the reference is told by what is weather in the other traverse."""
    probes = made_probes()
    own = np.cumsum(np.random.default_rng(3).normal(size=(60, 4)), axis=0)
    places = np.hstack([probes.places[:, :4], own]).astype(np.float32)
    torn = Probes(places, probes.descriptors, probes.truth)
    learned, identity = margins(IGNORES_WEATHER, torn), margins(None, torn)
    assert learned.contrast.mean() > identity.contrast.mean()
    assert learned.standardised.mean() > identity.standardised.mean()
    assert not passes_gate(IGNORES_WEATHER, torn)


def test_what_is_no_better_than_the_identity_is_refused():
    assert not passes_gate(3 * np.eye(8, dtype=np.float32), made_probes())


def test_a_gain_within_twice_its_standard_error_is_refused():
    probes = made_probes(count=4)
    rng = np.random.default_rng(0)
    by_chance = 0
    for _ in range(200):
        nearly = np.eye(8, dtype=np.float32) + 0.05 * rng.normal(size=(8, 8)).astype(np.float32)
        gains = margins(nearly, probes).standardised - margins(None, probes).standardised
        if 0 < gains.mean() <= gains.std(ddof=1):  # of 4 probes: two standard errors
            by_chance += 1
            assert not passes_gate(nearly, probes)
    assert by_chance > 0


def test_without_probes_nothing_passes():
    none = Probes(np.eye(4, dtype=np.float32), np.empty((0, 4), np.float32), np.empty(0, int))
    assert probe_score(None, none) == 0
    assert not passes_gate(2 * np.eye(4, dtype=np.float32), none)
