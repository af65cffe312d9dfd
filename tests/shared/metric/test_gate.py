import numpy as np
import pytest

from placefield.metric.gate import Probes, passes_gate, probe_margins, probe_score


def made_probes(count=40, seed=0, weather=0.0):
    """Places told apart by four dimensions; four more hold the weather, another in each probe."""
    rng = np.random.default_rng(seed)
    places = np.zeros((30, 8), np.float32)
    places[:, :4] = rng.normal(size=(30, 4))
    truth = rng.integers(0, 30, count)
    descriptors = places[truth] + 0.2 * rng.normal(size=(count, 8)).astype(np.float32)
    descriptors[:, 4:] += weather * rng.normal(size=(count, 4))
    descriptors[:, :4] *= rng.uniform(0.7, 1.3, size=(count, 1))
    return Probes(places, descriptors.astype(np.float32), truth)


def literal_margin(projection, probes, probe, tolerance):
    found = [
        float(((projection @ (place - probes.descriptors[probe])) ** 2).sum())
        for place in probes.places
    ]
    near = [abs(place - probes.truth[probe]) <= tolerance for place in range(len(found))]
    right = min(d for d, is_near in zip(found, near, strict=True) if is_near)
    wrong = min(d for d, is_near in zip(found, near, strict=True) if not is_near)
    return (wrong - right) / (wrong + right)


@pytest.mark.parametrize("tolerance", [0, 3])
def test_margins_are_the_literal_ones_and_the_score_their_mean(tolerance):
    probes = made_probes()
    projection = np.random.default_rng(2).normal(size=(5, 8)).astype(np.float32)
    expected = [literal_margin(projection, probes, p, tolerance) for p in range(40)]
    margins = probe_margins(projection, probes, tolerance)
    np.testing.assert_allclose(margins, expected, atol=1e-4)
    assert probe_score(projection, probes, tolerance) == pytest.approx(np.mean(expected), abs=1e-5)


def test_a_margin_is_positive_exactly_where_the_nearest_place_is_right():
    probes = made_probes(count=300, weather=1.5)
    offsets = probes.descriptors[:, None] - probes.places
    nearest = (offsets**2).sum(axis=-1).argmin(axis=1)
    is_right = np.abs(nearest - probes.truth) <= 1
    assert 0 < is_right.mean() < 1
    np.testing.assert_array_equal(probe_margins(None, probes, 1) > 0, is_right)


def test_no_projection_is_the_identity_at_any_scale():
    probes = made_probes()
    expected = probe_margins(None, probes, 1)
    scaled = probe_margins(np.float32(64) * np.eye(8, dtype=np.float32), probes, 1)
    np.testing.assert_allclose(scaled, expected, atol=1e-5)


def test_a_probe_that_equals_right_and_wrong_places_has_margin_zero():
    probes = Probes(np.ones((9, 2), np.float32), np.ones((1, 2), np.float32), np.array([4]))
    assert probe_margins(None, probes, 1).tolist() == [0.0]


def test_the_gate_passes_a_metric_that_ignores_the_weather_and_refuses_one_that_sees_nothing_else():
    probes = made_probes(weather=1.0)
    ignores = np.diag(np.repeat([1, 0.1], 4)).astype(np.float32)
    sees_it = np.diag(np.repeat([0.1, 1], 4)).astype(np.float32)
    assert passes_gate(ignores, probes, 1)
    assert not passes_gate(sees_it, probes, 1)


def test_the_gate_refuses_what_is_no_better_than_the_identity():
    assert not passes_gate(3 * np.eye(8, dtype=np.float32), made_probes(), 1)


def test_the_gate_refuses_a_gain_within_twice_its_standard_error():
    probes = made_probes(count=4, weather=0.3)
    rng = np.random.default_rng(0)
    kept = by_chance = 0
    for _ in range(200):
        nearly = np.eye(8, dtype=np.float32) + 0.05 * rng.normal(size=(8, 8)).astype(np.float32)
        gains = probe_margins(nearly, probes, 1) - probe_margins(None, probes, 1)
        within = 0 < gains.mean() <= gains.std(ddof=1)  # of 4 probes: two standard errors
        by_chance += within
        kept += within and passes_gate(nearly, probes, 1)
    assert by_chance > 0
    assert kept == 0


def test_without_probes_nothing_passes():
    none = Probes(np.eye(4, dtype=np.float32), np.empty((0, 4), np.float32), np.empty(0, int))
    assert probe_score(None, none, 1) == 0
    assert not passes_gate(2 * np.eye(4, dtype=np.float32), none, 1)
