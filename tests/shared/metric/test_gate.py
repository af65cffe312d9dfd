from dataclasses import fields

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from placefield.metric.gate import (
    TOLERANCE,
    Margins,
    Probes,
    _is_gain,
    margins,
    passes_gate,
    probe_score,
)

Array = NDArray[np.float32]


def weighing(place: float, weather: float, *others: float) -> Array:
    """A projection of four dimensions of place, four of weather, and others."""
    return np.diag([*[place] * 4, *[weather] * 4, *others]).astype(np.float32)


IGNORES_WEATHER = weighing(1, 0.1)
SEES_WEATHER = weighing(0.1, 1)
MARGINS = {field.name for field in fields(Margins)}


def made_probes() -> Probes:
    """A route whose places differ in four dimensions; four more hold the weather of each frame."""
    rng = np.random.default_rng(0)
    place = gaussian_filter1d(rng.normal(size=(60, 4)), 2, axis=0)
    places = np.hstack([place / place.std(), 1.5 * rng.normal(size=(60, 4))])
    truth = rng.choice(60, 40, replace=False)
    descriptors = places[truth] + 0.1 * rng.normal(size=(40, 8))
    descriptors[:, 4:] = 1.5 * rng.normal(size=(40, 4))
    return Probes(places.astype(np.float32), descriptors.astype(np.float32), truth)


def with_dimension(probes: Probes, of_places: Array, of_probes: Array) -> Probes:
    return Probes(
        np.column_stack([probes.places, of_places]).astype(np.float32),
        np.column_stack([probes.descriptors, of_probes]).astype(np.float32),
        probes.truth,
    )


def with_haze() -> Probes:
    """The other traverse is as far from every place by one dimension more."""
    probes = made_probes()
    return with_dimension(probes, np.zeros(60, np.float32), np.ones(40, np.float32))


def with_two_halves() -> Probes:
    """One dimension more has one value in the route's first half and another in its second."""
    probes = made_probes()
    half = np.repeat(np.array([-1, 1], np.float32), 30)
    return with_dimension(probes, half, half[probes.truth])


def with_a_walk_as_weather() -> Probes:
    """The reference's own frames differ by a feature that is weather in the other traverse."""
    probes = made_probes()
    walk = np.cumsum(np.random.default_rng(3).normal(size=(60, 4)), axis=0)
    places = np.hstack([probes.places[:, :4], walk]).astype(np.float32)
    return Probes(places, probes.descriptors, probes.truth)


def margins_that_gain(projection: Array, probes: Probes) -> set[str]:
    learned, identity = margins(projection, probes), margins(None, probes)
    return {name for name in MARGINS if _is_gain(getattr(learned, name) - getattr(identity, name))}


def reference_margins(
    projection: Array, frame: Array, truth: int, places: Array, without: int | None = None
) -> tuple[float, float]:
    """Contrast and standardised margin of one frame."""
    found = {
        place: float(((projection @ (descriptor - frame)) ** 2).sum())
        for place, descriptor in enumerate(places)
        if place != without
    }
    right = min(d for place, d in found.items() if abs(place - truth) <= TOLERANCE)
    wrong = min(d for place, d in found.items() if abs(place - truth) > TOLERANCE)
    return (wrong - right) / (wrong + right), (wrong - right) / float(np.std(list(found.values())))


def test_margins_are_those_of_the_reference_and_the_score_a_mean_of_them() -> None:
    probes = made_probes()
    projection = np.random.default_rng(2).normal(size=(5, 8)).astype(np.float32)
    found = margins(projection, probes)
    expected = np.array(
        [
            reference_margins(projection, frame, truth, probes.places)
            for frame, truth in zip(probes.descriptors, probes.truth, strict=True)
        ]
    )
    np.testing.assert_allclose(found.contrast, expected[:, 0], atol=1e-4)
    np.testing.assert_allclose(found.standardised, expected[:, 1], atol=1e-4)
    own = [
        reference_margins(projection, probes.places[place], place, probes.places, without=place)[0]
        for place in sorted(probes.truth)
    ]
    np.testing.assert_allclose(found.own_contrast, own, atol=1e-4)
    assert probe_score(projection, probes) == pytest.approx(expected[:, 1].mean(), abs=1e-4)


def test_no_projection_is_the_identity_at_any_scale() -> None:
    probes = made_probes()
    plain = margins(None, probes)
    scaled = margins(np.float32(64) * np.eye(8, dtype=np.float32), probes)
    for name in MARGINS:
        np.testing.assert_allclose(getattr(scaled, name), getattr(plain, name), atol=1e-4)


@pytest.mark.parametrize("count", [2 * TOLERANCE, 30])
def test_margins_are_zero_where_all_distances_are_equal_or_no_place_is_wrong(count: int) -> None:
    alike = Probes(np.ones((count, 2), np.float32), np.ones((1, 2), np.float32), np.array([4]))
    found = margins(None, alike)
    for name in MARGINS:
        assert getattr(found, name).tolist() == [0.0]


def test_a_metric_that_ignores_the_weather_passes_and_one_of_nothing_else_does_not() -> None:
    probes = made_probes()
    assert passes_gate(IGNORES_WEATHER, probes)
    assert not passes_gate(SEES_WEATHER, probes)


@pytest.mark.parametrize(
    ("probes", "projection", "failing"),
    [
        (with_haze(), weighing(1, 0.1, 10), "contrast"),
        (with_two_halves(), weighing(1, 0.1, 10), "standardised"),
        (with_a_walk_as_weather(), IGNORES_WEATHER, "own_contrast"),
    ],
    ids=["contrast", "standardised", "own_contrast"],
)
def test_a_metric_that_gains_in_all_margins_but_one_is_refused(
    probes: Probes, projection: Array, failing: str
) -> None:
    assert margins_that_gain(projection, probes) == MARGINS - {failing}
    assert not passes_gate(projection, probes)


def test_a_metric_no_better_than_the_identity_is_refused() -> None:
    assert not passes_gate(3 * np.eye(8, dtype=np.float32), made_probes())


@pytest.mark.parametrize("count", [2, 4, 100])
def test_a_gain_is_one_above_twice_its_standard_error(count: int) -> None:
    """That of numbers half of which are 1 and half -1 is 1 / sqrt(count - 1)."""
    spread = np.tile(np.array([1, -1], np.float32), count // 2)
    bound = np.float32(2 / np.sqrt(count - 1))
    assert not _is_gain(spread + np.float32(0.999) * bound)
    assert _is_gain(spread + np.float32(1.001) * bound)


@pytest.mark.filterwarnings("error")
def test_one_probe_is_no_gain() -> None:
    assert not _is_gain(np.ones(1, np.float32))


def test_without_probes_nothing_passes() -> None:
    none = Probes(np.eye(4, dtype=np.float32), np.empty((0, 4), np.float32), np.empty(0, int))
    assert probe_score(None, none) == 0
    assert not passes_gate(2 * np.eye(4, dtype=np.float32), none)
