"""The filter against its model, state by state, and on routes made up of unit descriptors."""

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.matching.distances import PlaceDistances
from placefield.matching.place_filter import (
    _FIND,
    _LOSE,
    _LOST_EVIDENCE,
    _NOISE,
    _SHEETS,
    _SLIP,
    _SPEED_PRIOR,
    _STEP_DEVIATION,
    _STOP,
    SPEEDS,
    STEPS,
    PlaceFilter,
)

Array = NDArray[np.float32]
Point = list[float]
State = tuple[int, float, int] | None
"""Sheet (0 the map, 1 the decoy), speed and place; None where the vehicle is lost."""

PRIOR: dict[float, float] = dict(zip(SPEEDS.tolist(), _SPEED_PRIOR.tolist(), strict=True))
LOST: State = None


class LiteralFilter:
    """Weights of all states that explain the frames so far, carried from state to state."""

    def __init__(self, places: list[Point], persistence: float) -> None:
        self.sheets = (places, places[::-1])
        self.places = places
        self.persistence = persistence
        self.weights: dict[State, float] = {LOST: 0.5} | self.anywhere(0.5)
        self.last: Point | None = None
        self.begun = False

    def anywhere(self, weight: float) -> dict[State, float]:
        return {
            (sheet, speed, place): weight * share * PRIOR[speed] / len(self.places)
            for sheet, share in enumerate(_SHEETS)
            for speed in PRIOR
            for place in range(len(self.places))
        }

    def push(self, frame: Point | None) -> None:
        if self.begun:
            self.move(frame)
        if frame is not None:
            self.see(frame)
            self.begun = True
        self.last = frame

    def move(self, frame: Point | None) -> None:
        moved: dict[State, float] = defaultdict(float)
        for state, weight in self.weights.items():
            if state is None:
                weight *= self.step_likelihood_anywhere(frame)
                moved[LOST] += (1 - _FIND) * weight
                for found, share in self.anywhere(_FIND * weight).items():
                    moved[found] += share
                continue
            moved[LOST] += _LOSE * weight * self.jump_likelihood(frame)
            sheet, speed, place = state
            for new_speed in PRIOR:
                for step in STEPS:
                    arrival = place + step
                    if arrival < len(self.places):
                        chance = self.change_chance(speed, new_speed) * step_chance(new_speed, step)
                        chance *= self.step_likelihood(frame, sheet, step, arrival)
                        moved[sheet, new_speed, arrival] += (1 - _LOSE) * weight * chance
        self.weights = moved

    def change_chance(self, speed: float, new_speed: float) -> float:
        change = 1 / max(self.persistence if speed > 0 else _STOP, 1)
        return change * PRIOR[new_speed] + (1 - change) * (speed == new_speed)

    def step_likelihood(self, frame: Point | None, sheet: int, step: int, arrival: int) -> float:
        if frame is None or self.last is None:
            return 1
        floor = _NOISE * self.typical_step
        expected = max(self.step_length(sheet, step, arrival), floor)
        return student(max(math.dist(frame, self.last), floor) - expected)

    def step_likelihood_anywhere(self, frame: Point | None) -> float:
        total = 0.0
        for speed in PRIOR:
            for step in STEPS:
                for place in range(len(self.places)):
                    likelihood = self.step_likelihood(frame, 0, step, place)
                    total += PRIOR[speed] * step_chance(speed, step) * likelihood
        return total / len(self.places)

    def jump_likelihood(self, frame: Point | None) -> float:
        """A jump is as long as the way from a place to the one half the route behind it."""
        if frame is None or self.last is None:
            return 1
        count = len(self.places)
        lengths = [
            math.dist(self.places[j], self.places[(j - count // 2) % count]) for j in range(count)
        ]
        return sum(student(math.dist(frame, self.last) - length) for length in lengths) / count

    def step_length(self, sheet: int, step: int, arrival: int) -> float:
        """Before a step can be made in the map, it has the mean length of those that can."""
        places = self.sheets[sheet]
        if arrival >= step:
            return math.dist(places[arrival], places[arrival - step])
        made = [self.step_length(sheet, step, place) for place in range(step, len(places))]
        return sum(made) / len(made) if made else 0.0

    @property
    def typical_step(self) -> float:
        return float(np.median([self.step_length(0, 1, j) for j in range(len(self.places))])) or 1

    def see(self, frame: Point) -> None:
        distances = [math.dist(frame, place) ** 2 for place in self.places]
        mean = sum(distances) / len(distances)
        variance = sum((distance - mean) ** 2 for distance in distances) / len(distances)
        if math.isclose(variance, 0, abs_tol=1e-12):
            return
        novelty = self.novelty(frame)
        # Likelihoods are up to a factor; relative to the mean distance none is 0.
        likelihoods = [
            math.exp(-novelty * (distance - mean) / math.sqrt(variance)) for distance in distances
        ]
        lost = math.exp(novelty * _LOST_EVIDENCE) * sum(likelihoods) / len(likelihoods)
        for state in self.weights:
            if state is None:
                self.weights[state] *= lost
            else:
                sheet, _, place = state
                self.weights[state] *= likelihoods[place if sheet == 0 else -1 - place]

    def novelty(self, frame: Point) -> float:
        if self.last is None:
            return 1
        return min(1, math.dist(frame, self.last) / self.typical_step)

    @property
    def belief(self) -> list[float]:
        total = sum(self.weights.values())
        return [
            sum(self.weights[0, speed, place] for speed in PRIOR) / total
            for place in range(len(self.places))
        ]


def student(difference: float) -> float:
    return float((1 + (difference / _STEP_DEVIATION) ** 2 / 2) ** -1.5)


def step_chance(speed: float, step: int) -> float:
    return (1 - _SLIP) * max(1 - abs(speed - step), 0) + _SLIP / len(STEPS)


def filter_of(places: Array, persistence: float) -> tuple[PlaceDistances, PlaceFilter]:
    distances = PlaceDistances(np.eye(places.shape[1], dtype=np.float32), places)
    return distances, PlaceFilter(distances, persistence)


def push(distances: PlaceDistances, place_filter: PlaceFilter, frame: Array | None) -> None:
    if frame is None:
        place_filter.push_unseen()
    else:
        place_filter.push(frame, distances.to(frame))


points = st.lists(st.integers(-6, 6).map(lambda n: n / 4), min_size=3, max_size=3)
"""Coarse, so that distances are exact in float32 and points coincide."""


@st.composite
def maps(draw: st.DrawFn) -> list[Point]:
    places = draw(st.lists(points, min_size=1, max_size=7))
    return draw(st.sampled_from([places, places[:1] * len(places)]))


@st.composite
def queries(draw: st.DrawFn) -> list[Point | None]:
    """Each frame is new, not seen, or the last one that was seen once more."""
    frames: list[Point | None] = []
    last: Point | None = None
    for frame in draw(st.lists(points | st.sampled_from(["unseen", "again"]), max_size=10)):
        last = frame if isinstance(frame, list) else last
        frames.append(None if frame == "unseen" else last)
    return frames


@given(maps(), st.sampled_from([0.5, 1, 4, 12.5]), queries())
@settings(max_examples=200)
def test_belief_is_that_of_the_model(
    places: list[Point], persistence: float, query: list[Point | None]
) -> None:
    distances, place_filter = filter_of(np.array(places, np.float32), persistence)
    literal = LiteralFilter(places, persistence)
    for frame in query:
        push(distances, place_filter, None if frame is None else np.array(frame, np.float32))
        literal.push(frame)
        np.testing.assert_allclose(place_filter.belief, literal.belief, rtol=0, atol=1e-9)


coordinates = st.floats(allow_nan=False, allow_infinity=False, width=32)
seen = st.tuples(
    st.lists(coordinates, min_size=3, max_size=3),
    st.lists(coordinates.map(abs), min_size=7, max_size=7),
)


@given(maps(), st.lists(seen | st.none(), min_size=1, max_size=12))
def test_belief_is_a_probability_whatever_comes(
    places: list[Point], query: list[tuple[Point, list[float]] | None]
) -> None:
    _, place_filter = filter_of(np.array(places, np.float32), 8)
    for frame in query:
        if frame is None:
            place_filter.push_unseen()
        else:
            projected, distances = (np.array(values, np.float32) for values in frame)
            place_filter.push(projected, distances[: len(places)])
        belief = place_filter.belief
        assert np.isfinite(belief).all()
        assert np.all(belief >= 0)
        assert belief.sum() <= 1 + 1e-12


DIMENSIONS = 32


@dataclass(frozen=True)
class Route:
    """Looks that change gradually, and a map of them; each drive sees them with noise of its own.

    A drive has a season, too, that all of its frames share.
    """

    looks: NDArray[np.float64]
    seed: int

    @classmethod
    def random(cls, seed: int, places: int = 200) -> "Route":
        rng = np.random.default_rng(seed)
        looks = rng.standard_normal((places, DIMENSIONS))
        for place in range(1, places):
            looks[place] = 0.9 * looks[place - 1] + math.sqrt(1 - 0.9**2) * looks[place]
        return cls(looks / math.sqrt(DIMENSIONS), seed)

    @property
    def places(self) -> Array:
        return seen_with_noise(self.looks, np.random.default_rng(self.seed + 1))

    def drive(self, positions: NDArray[np.floating]) -> Array:
        """Return a frame for each position, in places; where it is the last one's, that frame."""
        rng = np.random.default_rng(self.seed + 2)
        before = np.floor(positions).astype(int)
        after = np.minimum(before + 1, len(self.looks) - 1)
        share = (positions - before)[:, None]
        looks = (1 - share) * self.looks[before] + share * self.looks[after]
        season = 0.5 * rng.standard_normal(DIMENSIONS) / math.sqrt(DIMENSIONS)
        frames = seen_with_noise(looks + season, rng)
        for number in np.flatnonzero(np.diff(positions) == 0) + 1:
            frames[number] = frames[number - 1]
        return frames


def seen_with_noise(looks: NDArray[np.float64], rng: np.random.Generator) -> Array:
    noisy = looks + 0.1 * rng.standard_normal(looks.shape) / math.sqrt(DIMENSIONS)
    return np.asarray(noisy / np.linalg.norm(noisy, axis=1, keepdims=True), np.float32)


def filtered(places: Array, frames: Array) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the most believed place and the probability of being lost, after each frame."""
    distances, place_filter = filter_of(places, persistence=16)
    most_believed, lost = [], []
    for frame in frames:
        push(distances, place_filter, frame)
        most_believed.append(int(np.argmax(place_filter.belief)))
        lost.append(1 - place_filter.belief.sum())
    return np.array(most_believed), np.array(lost)


@pytest.fixture(params=[0, 1, 2])
def route(request: pytest.FixtureRequest) -> Route:
    return Route.random(request.param)


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5, 2.0])
def test_a_query_is_followed_at_any_speed(route: Route, speed: float) -> None:
    positions = 20 + speed * np.arange(80)
    places, _ = filtered(route.places, route.drive(positions))
    off = np.abs(places - positions)[10:]
    assert off.mean() < 1
    assert np.mean(off <= 3) > 0.9


def test_a_query_is_followed_through_stops(route: Route) -> None:
    """A stop is noticed late, and what has rolled on in belief until then is taken back."""
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
