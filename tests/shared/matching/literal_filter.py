"""The model of ``PlaceFilter`` in float64, written out state by state, for tests.

Its constants are those of docs/method.md.
"""

import math

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Weights = dict[tuple[int, float], NDArray[np.float64]]
"""By sheet (0 the map, 1 the decoy) and speed, of every place, (K,)."""

PRIOR = {0.0: 0.1, 0.5: 0.1, 0.75: 0.1, 1.0: 0.4, 1.25: 0.1, 1.5: 0.1, 2.0: 0.1}
"""Chance of each speed after a change, places per frame."""

STEPS = (0, 1, 2)
SLIP = 0.05
STOP = 5  # frames
STEP_DEVIATION = 0.3
STANDING = 0.05  # of the median step
LOSE = 0.003
FIND = 0.2
LOST_AT_FIRST = 0.5
LOST_EVIDENCE = 0.75
SHEETS = (0.2, 0.8)
SAMPLE = 1000


class LiteralFilter:
    """Weights of all states that explain the frames so far, carried from state to state.

    The decoy is a map of the same places the other way around.
    """

    def __init__(self, places: Points, persistence: float) -> None:
        """Take the places (K, M) and how long a speed lasts, in frames."""
        self.sheets = (places, places[::-1])
        self.places = places
        self.count = len(places)
        self.some = range(0, self.count, math.ceil(self.count / SAMPLE))
        self.lengths = {
            (sheet, step): step_lengths(self.sheets[sheet], step)
            for sheet in range(2)
            for step in STEPS
        }
        self.typical_step = float(np.median(self.lengths[0, 1])) or 1.0
        self.persistence = persistence
        self.lost, self.weights = LOST_AT_FIRST, self.anywhere(1 - LOST_AT_FIRST)
        self.last: Points | None = None
        self.begun = False

    def anywhere(self, weight: float) -> Weights:
        return {
            (sheet, speed): np.full(self.count, weight * share * PRIOR[speed] / self.count)
            for sheet, share in enumerate(SHEETS)
            for speed in PRIOR
        }

    def push(self, frame: Points | None) -> None:
        """Take the next frame (M,), or one that was not seen."""
        if self.begun:
            self.move(frame)
        if frame is not None:
            self.see(frame)
            self.begun = True
        self.last = frame
        self.normalise()

    def normalise(self) -> None:
        total = self.lost + sum(float(of_places.sum()) for of_places in self.weights.values())
        self.lost /= total
        for of_places in self.weights.values():
            of_places /= total

    def move(self, frame: Points | None) -> None:
        was_lost = self.lost * self.step_likelihood_anywhere(frame)
        on_a_sheet = sum(float(of_places.sum()) for of_places in self.weights.values())
        moved = self.anywhere(FIND * was_lost)
        for (sheet, speed), of_places in self.weights.items():
            for step in STEPS:
                likelihood = self.step_likelihood(frame, sheet, step)[step:]
                arrived = (1 - LOSE) * of_places[: max(self.count - step, 0)] * likelihood
                for new_speed in PRIOR:
                    chance = self.change_chance(speed, new_speed) * step_chance(new_speed, step)
                    moved[sheet, new_speed][step:] += chance * arrived
        self.lost = (1 - FIND) * was_lost + LOSE * on_a_sheet * self.jump_likelihood(frame)
        self.weights = moved

    def change_chance(self, speed: float, new_speed: float) -> float:
        change = 1 / max(self.persistence if speed > 0 else STOP, 1)
        return change * PRIOR[new_speed] + (1 - change) * (speed == new_speed)

    def step_likelihood(self, frame: Points | None, sheet: int, step: int) -> Points:
        """Of the step that leads to each place, (K,)."""
        if frame is None or self.last is None:
            return np.ones(self.count)
        floor = STANDING * self.typical_step
        expected = np.maximum(self.lengths[sheet, step], floor)
        return student(max(math.dist(frame, self.last), floor) - expected)

    def step_likelihood_anywhere(self, frame: Points | None) -> float:
        total = 0.0
        for speed in PRIOR:
            for step in STEPS:
                likelihoods = self.step_likelihood(frame, 0, step)
                mean = sum(likelihoods[place] for place in self.some) / len(self.some)
                total += PRIOR[speed] * step_chance(speed, step) * mean
        return total

    def jump_likelihood(self, frame: Points | None) -> float:
        """A jump is as long as the way from a place to the one half the route behind it."""
        if frame is None or self.last is None:
            return 1
        there = [(place - self.count // 2) % self.count for place in self.some]
        lengths = np.linalg.norm(self.places[self.some] - self.places[there], axis=1)
        return float(student(math.dist(frame, self.last) - lengths).mean())

    def see(self, frame: Points) -> None:
        distances = ((self.places - frame) ** 2).sum(axis=1)
        if math.isclose(distances.var(), 0, abs_tol=1e-12):
            return
        novelty = self.novelty(frame)
        # Likelihoods are up to a factor; relative to the mean distance none is 0.
        likelihoods = np.exp(-novelty * (distances - distances.mean()) / distances.std())
        self.lost *= math.exp(novelty * LOST_EVIDENCE) * likelihoods.mean()
        for (sheet, _), of_places in self.weights.items():
            of_places *= likelihoods if sheet == 0 else likelihoods[::-1]

    def novelty(self, frame: Points) -> float:
        if self.last is None:
            return 1
        return min(1, math.dist(frame, self.last) / self.typical_step)

    @property
    def beliefs(self) -> Points:
        """By sheet, speed and place, the decoy's places in the order of the map: (2, S, K)."""
        return np.array(
            [
                [self.weights[sheet, speed][:: 1 if sheet == 0 else -1] for speed in PRIOR]
                for sheet in range(2)
            ]
        )


def step_lengths(places: Points, step: int) -> Points:
    """Length of the step to each place; before one can be made, the mean of those that can."""
    made = np.linalg.norm(places[step:] - places[: max(len(places) - step, 0)], axis=1)
    missing = min(step, len(places))
    return np.concatenate([np.full(missing, made.mean() if len(made) else 0.0), made])


def student(difference: Points) -> Points:
    return np.asarray((1 + (difference / STEP_DEVIATION) ** 2 / 2) ** -1.5)


def step_chance(speed: float, step: int) -> float:
    return (1 - SLIP) * max(1 - abs(speed - step), 0) + SLIP / len(STEPS)
