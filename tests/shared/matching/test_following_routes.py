"""The filter on drives along routes that are made up of unit descriptors."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from comparisons import compared
from filters import filter_of, posterior_of
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.fusion.rules import fuse
from placefield.maps.map_metrics import identity_metric

pytestmark = pytest.mark.slow

Array = NDArray[np.float32]
DIMENSIONS = 32


@dataclass(frozen=True)
class Route:
    """Views that change gradually, and a map of them; each drive observes them with its own noise.

    All frames of a drive have an offset in common, like a season.
    """

    views: NDArray[np.float64]
    seed: int

    @classmethod
    def random(cls, seed: int, places: int = 200) -> "Route":
        rng = np.random.default_rng(seed)
        views = rng.standard_normal((places, DIMENSIONS))
        for place in range(1, places):
            views[place] = 0.9 * views[place - 1] + math.sqrt(1 - 0.9**2) * views[place]
        return cls(views / math.sqrt(DIMENSIONS), seed)

    @property
    def places(self) -> Array:
        return observed_with_noise(self.views, np.random.default_rng(self.seed + 1))

    def drive(self, positions: NDArray[np.floating]) -> Array:
        """Return a frame for each position, in places; where it is the last one's, that frame."""
        rng = np.random.default_rng(self.seed + 2)
        before = np.floor(positions).astype(int)
        after = np.minimum(before + 1, len(self.views) - 1)
        fraction = (positions - before)[:, None]
        views = (1 - fraction) * self.views[before] + fraction * self.views[after]
        season = 0.5 * rng.standard_normal(DIMENSIONS) / math.sqrt(DIMENSIONS)
        frames = observed_with_noise(views + season, rng)
        for number in np.flatnonzero(np.diff(positions) == 0) + 1:
            frames[number] = frames[number - 1]
        return frames


def observed_with_noise(views: NDArray[np.float64], rng: np.random.Generator) -> Array:
    noisy = views + 0.1 * rng.standard_normal(views.shape) / math.sqrt(DIMENSIONS)
    return np.asarray(noisy / np.linalg.norm(noisy, axis=1, keepdims=True), np.float32)


def filtered(places: Array, frames: Array) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the likeliest place and the probability of being lost, after each frame."""
    metric = identity_metric(places)
    matcher = filter_of(metric)
    best_places, lost = [], []
    for frame in compared(metric, [*frames]):
        candidate = matcher.update(frame)
        best_places.append(candidate.place)
        lost.append(1 - posterior_of(candidate, len(places)).sum())
    return np.array(best_places), np.array(lost)


@pytest.fixture(params=[0, 1, 2])
def route(request: pytest.FixtureRequest) -> Route:
    return Route.random(request.param)


@pytest.mark.parametrize("speed", [1 / 30, 0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 4.0, 6.0])
def test_a_query_is_followed_at_any_speed(route: Route, speed: float) -> None:
    """After eight views, of which a slow vehicle has one at each place."""
    positions = 20 + speed * np.arange(min(int(170 / speed), 400))
    places, _ = filtered(route.places, route.drive(positions))
    off = np.abs(places - positions)[int(8 / min(speed, 1)) :]
    assert off.mean() < 2
    assert np.mean(off <= 3) > 0.95


@pytest.mark.parametrize("speed", [7.0, 7.5, 9.0, 12.0])
def test_at_a_speed_that_the_map_does_not_resolve_nothing_is_known(
    route: Route, speed: float
) -> None:
    positions = speed * np.arange(int(199 / speed))
    _, lost = filtered(route.places, route.drive(positions))
    assert lost[3:].min() > 0.01


def too_fast_frames(route: Route, speed: float) -> NDArray[np.bool_]:
    """Return which matches of a drive are too fast."""
    places = route.places
    metric, matching = identity_metric(places), MatchingConfig()
    matcher = filter_of(metric)
    frames = route.drive(speed * np.arange(int((len(places) - 1) / speed)))
    matches = [fuse([matcher.update(frame)], matching) for frame in compared(metric, [*frames])]
    assert not any(match.known for match in matches if match.too_fast)
    return np.array([match.too_fast for match in matches])


@pytest.mark.parametrize("speed", [7.0, 8.0, 9.0, 11.0])
def test_a_drive_that_is_too_fast_for_the_map_is_reported_so(route: Route, speed: float) -> None:
    assert too_fast_frames(route, speed)[6:].mean() > 0.9


@pytest.mark.parametrize("speed", [0.25, 1.0, 4.0, 6.0])
def test_a_drive_that_the_map_resolves_is_never_reported_too_fast(
    route: Route, speed: float
) -> None:
    assert not too_fast_frames(route, speed).any()


def test_a_query_is_followed_through_stops(route: Route) -> None:
    """A stop is noticed late; the belief that moved on until then is corrected."""
    stops = [40, 80, 120]
    positions = np.repeat(np.arange(150.0), [8 if place in stops else 1 for place in range(150)])
    places, _ = filtered(route.places, route.drive(positions))
    off = np.abs(places - positions)
    assert np.mean(off[10:] <= 3) > 0.9
    for stop in stops:
        moving_again = np.flatnonzero(positions == stop)[-1] + 6
        assert off[moving_again : moving_again + 20].max() <= 1


def test_after_a_jump_the_query_is_found_again_within_a_few_frames(route: Route) -> None:
    for there in (140, 20):
        positions = np.concatenate([np.arange(30.0, 90), np.arange(there, there + 40.0)])
        places, lost = filtered(route.places, route.drive(positions))
        assert np.abs(places - positions)[60 + 8 :].max() <= 2
        assert lost[60:68].max() > lost[10:60].max()


def test_on_foreign_frames_the_vehicle_is_lost_more_likely(route: Route) -> None:
    known = route.drive(np.arange(60.0))
    foreign = Route.random(99).drive(np.arange(40.0))
    _, lost = filtered(route.places, np.concatenate([known, foreign]))
    assert np.median(lost[65:]) > 2 * lost[10:60].max()
