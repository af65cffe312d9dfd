from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.matching import revisits
from placefield.matching.revisits import same_places

Array = NDArray[np.float32]


def route(places: int, seed: int = 0) -> Array:
    """A route whose views change gradually, (places, 40)."""
    rng = np.random.default_rng(seed)
    views = np.zeros((places, 40), np.float32)
    view = rng.normal(size=40)
    for place in range(places):
        view = 0.7 * view + rng.normal(size=40)
        views[place] = view
    return views


def drive(views: Array, *laps: Sequence[int], noise: float = 0.4) -> Array:
    """Descriptors of laps, which pass places of a route, each with noise of its own."""
    rng = np.random.default_rng(1)
    frames = np.concatenate([views[list(lap)] for lap in laps])
    observed = frames + rng.normal(scale=noise, size=frames.shape)
    observed /= np.linalg.norm(observed, axis=1, keepdims=True)
    return np.asarray(observed, np.float32)


def test_places_of_one_lap_are_all_different() -> None:
    assert same_places(drive(route(300), range(300))).tolist() == [*range(300)]


@pytest.mark.parametrize("laps", [2, 3])
def test_every_later_lap_is_the_same_as_the_first(laps: int) -> None:
    same = same_places(drive(route(120), *[range(120)] * laps))
    off = np.abs(same - np.arange(120 * laps) % 120)
    assert same[:120].tolist() == [*range(120)]
    assert np.mean(off[120:] <= 1) >= 0.95
    np.testing.assert_array_equal(same[same], same)


def test_a_lap_at_another_speed_is_the_same_as_the_first() -> None:
    same = same_places(drive(route(160), range(160), range(0, 160, 2)))
    off = np.abs(same[160:] - np.arange(0, 160, 2))
    assert np.mean(off <= 2) >= 0.9


def test_a_circuit_that_closes_ends_where_it_began() -> None:
    same = same_places(drive(route(150), range(150), range(20)))
    assert same[:150].tolist() == [*range(150)]
    assert np.mean(np.abs(same[150:] - np.arange(20)) <= 1) >= 0.9


def test_of_a_figure_of_eight_the_stretch_that_is_passed_twice_is_the_same() -> None:
    same = same_places(drive(route(240), range(140), range(40, 80), range(140, 240)))
    different = [*range(138), *range(184, 280)]
    assert same[different].tolist() == different
    assert np.mean(np.abs(same[140:180] - np.arange(40, 80)) <= 1) >= 0.9


def test_a_stretch_that_is_passed_in_reverse_is_another_one() -> None:
    there_and_back = drive(route(120), range(120), range(119, -1, -1))
    assert same_places(there_and_back).tolist() == [*range(240)]


def test_two_stretches_that_resemble_each_other_place_by_place_are_not_joined() -> None:
    views = route(100)
    alike = 0.3 * views + 0.95 * route(100, seed=5)  # of the same variance, and correlated by .3
    same = same_places(drive(np.concatenate([views, route(60, seed=6), alike]), range(260)))
    assert same.tolist() == [*range(260)]


def test_two_corridors_of_one_look_are_not_joined() -> None:
    view = 2 * np.random.default_rng(2).normal(size=40)
    corridors = [view + route(100, seed=seed) for seed in (3, 4)]
    views = np.concatenate([corridors[0], route(60), corridors[1]])
    assert same_places(drive(views, range(260))).tolist() == [*range(260)]


def test_a_monotonous_route_is_joined_nowhere() -> None:
    slow = np.repeat(route(40), 12, axis=0)
    assert same_places(drive(slow, range(480), noise=0.2)).tolist() == [*range(480)]


@pytest.mark.parametrize("places", [1, 2, 30])
def test_a_route_of_few_places_or_of_nothing_but_one_image_has_none(places: int) -> None:
    alike = np.tile(np.eye(1, 40, dtype=np.float32), (places, 1))
    assert same_places(alike).tolist() == [*range(places)]
    assert same_places(drive(route(places), range(places))).tolist() == [*range(places)]


def test_of_a_long_route_every_nth_place_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    between = np.repeat(route(100), 3, axis=0)
    between[1:-1] = (between[:-2] + between[1:-1] + between[2:]) / 3
    monkeypatch.setattr(revisits, "MOST", 200)
    same = same_places(drive(between, range(300), range(300), noise=0.2))
    np.testing.assert_array_equal(same[same], same)
    assert np.mean(np.abs(same[300:] - np.arange(300)) <= 3) >= 0.9


def test_routes_that_share_a_stretch_are_the_same_there_also_where_one_begins_as_another_ends() -> (
    None
):
    views = route(200)
    same = same_places(drive(views, range(90), range(60, 200)), np.array([0, 90], np.int32))
    assert same[:90].tolist() == [*range(90)]
    assert np.mean(np.abs(same[90:120] - np.arange(60, 90)) <= 1) >= 0.9
    assert same[125:].tolist() == [*range(125, 230)]


def test_routes_of_different_places_are_all_different() -> None:
    views = np.concatenate([route(150, seed=3), route(150, seed=4)])
    starts = np.array([0, 150], np.int32)
    assert same_places(drive(views, range(300)), starts).tolist() == [*range(300)]
