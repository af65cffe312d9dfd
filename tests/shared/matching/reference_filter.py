"""The rule ``filter`` after docs/method.md, in float64: the reference for tests.

Predict, update and smooth are those of the textbook version, which has tests of its own.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from placefield.maps.topology import Topology
from placefield.matching.carrying import carry
from placefield.matching.motion import FIND, HYPOTHESES, LOSE
from placefield.matching.odometry import Displacement, speeds_of
from placefield.matching.roads import roads_of
from placefield.matching.textbook import (
    Likelihood,
    Predicted,
    State,
    Step,
    initial,
    predict,
    predict_backward,
    update,
    ways_of,
)

Points = NDArray[np.float64]

SPEEDS = [0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1, 5 / 4, 3 / 2, 2, 3, 4, 5, 6, 7, 9, 11]
RESOLVED = 15  # speeds
PRIOR = np.array([2, 1, 1, 1, 2, 2, 2, 8, 2, 2, 2, 2, 2, 1, 1, 0.5, 0.25, 0.25]) / 32
REACH = 12
PERSISTENCE = 60  # frames
STOP = 5
STEP_DEVIATION = 0.3
STATIONARY = 0.05  # of the median step
SAMPLE = 250
NATS_PER_DEVIATION = 1.25
REPEATED = 1e-3
FORGET = 0.99
LOST_FRACTION = 0.55
AGAIN = 0.1
SAMPLED = 1000
NOVEL = 0.25


@dataclass(frozen=True)
class OdometryStep:
    """A step with odometry.

    Attributes:
        speeds: (S,), chance of each.
        chances: (2, K, K), of a step from each place to each, on the map and on its reverse.
        likelihood: (K,), of the observed step, by the place that it leads to.
        lost_likelihood: the same when lost.
        jump: the same for a vehicle that jumps.
    """

    speeds: Points
    chances: Points
    likelihood: Points
    lost_likelihood: float
    jump: float

    def predict(self, state: State) -> Predicted:
        by_place = state.placed.sum(axis=1)
        count, here = by_place.shape[1], np.einsum("hii->hi", self.chances)
        moved = np.einsum("hi,hij->hj", by_place, self.chances)
        kept = (1 - LOSE) * self.speeds[:, None] * self.likelihood
        adrift = self.lost_likelihood * float(state.lost.sum()) * self.speeds
        found = FIND * HYPOTHESES[:, None, None] * adrift[:, None] / count
        left = LOSE * self.jump * float(by_place.sum()) * self.speeds
        stayed = (by_place * here)[:, None]
        came = (moved - by_place * here)[:, None]
        return Predicted(kept * stayed, kept * came + found, (1 - FIND) * adrift + left)

    def predict_backward(self, backward: State, likelihood: Likelihood) -> State:
        count, here = len(self.likelihood), np.einsum("hii->hi", self.chances)
        message = np.einsum("s,hsk->hk", self.speeds, backward.placed)
        anew = message * likelihood.anew
        when_lost = float(self.speeds @ backward.lost)
        found = float((HYPOTHESES[:, None] * anew).sum()) / count
        lost = self.lost_likelihood * ((1 - FIND) * when_lost + FIND * found)
        there, again = anew * self.likelihood, message * likelihood.again * self.likelihood
        reached = np.einsum("hij,hj->hi", self.chances, there) + here * (again - there)
        placed = (1 - LOSE) * reached + LOSE * self.jump * when_lost
        shape = backward.placed.shape
        return State(np.broadcast_to(placed[:, None], shape), np.full(len(SPEEDS), lost))


class ReferenceFilter:
    """The distribution over all states, frame by frame, and the data that the smoother needs."""

    def __init__(self, places: Points, topology: Topology | None = None) -> None:
        """Prepare for places (K, M)."""
        count = len(places)
        topology = topology or Topology.line(count)
        self.roads, self.route = roads_of(topology), roads_of(topology).cells
        self.places, self.graph = places, topology.graph
        self.ways = ways_of(self.graph, count)
        self.before = self.likeliest_before(self.ways[0].toarray())
        self.apart = [self.lengths_of_steps(step) for step in range(1, 7)]
        self.typical = float(np.median(self.apart[0])) or 1.0
        self.stationary = STATIONARY * self.typical
        self.some = range(0, count, math.ceil(count / SAMPLE))
        self.state: State | None = None
        self.last: Points | None = None
        self.speeds = np.zeros(len(SPEEDS))  # posterior counts
        self.evidence, self.weight = 0.0, 0.0
        self.deviations, self.deviation_weight = 0.0, 0.0
        self.filtered: list[State] = []
        self.steps: list[Step | OdometryStep] = []
        self.likelihoods: list[Likelihood] = []
        self.frames: list[int | None] = []
        """Index of each frame in these lists; None before the first observation."""

    def lengths_of_steps(self, step: int) -> Points:
        """Return the step length to each place; the mean at the map's beginning."""
        lengths = np.full(len(self.places), np.nan)
        for place in range(len(self.places)):
            before: int | None = place
            for _ in range(step):
                before = None if before is None else self.before[before]
            if before is not None:
                lengths[place] = math.dist(self.places[place], self.places[before])
        if np.isnan(lengths).all():
            return np.zeros(len(self.places)) if step == 1 else self.lengths_of_steps(step - 1)
        return np.where(np.isnan(lengths), np.nanmean(lengths), lengths)

    def likeliest_before(self, chances: Points) -> list[int | None]:
        """Return from where the most vehicles come to each place; of several, the one in the route.

        Args:
            chances: (K, K), of the way from each place to each.
        """
        likeliest: list[int | None] = [
            int(place) if chance > 0 else None
            for place, chance in zip(chances.argmax(axis=0), chances.max(axis=0), strict=True)
        ]
        for place in set(range(1, len(likeliest))) - set(self.graph.first):
            if chances[place - 1, place] == chances[:, place].max() > 0:
                likeliest[place] = place - 1
        return likeliest

    def update(self, frame: Points | None, displacement: Displacement | None = None) -> None:
        """Add the next frame (M,), or a missing observation, and its displacement if known."""
        repeated = (
            frame is not None and self.last is not None and math.dist(frame, self.last) <= REPEATED
        )
        if not repeated and (frame is not None or self.filtered):
            self.advance(frame, displacement)
        self.frames.append(len(self.filtered) - 1 if self.filtered else None)

    def advance(self, frame: Points | None, displacement: Displacement | None) -> None:
        known = frame is not None and self.last is not None
        length = math.dist(frame, self.last) if known else None  # type: ignore[arg-type]
        step = (
            self.step(length) if displacement is None else self.odometry_step(length, displacement)
        )
        novelty, evidence, lost_evidence = self.observe(frame, length)
        some = evidence[:: math.ceil(len(evidence) / SAMPLED)]
        against_lost = evidence - math.log(np.exp(some).mean()) - lost_evidence
        most = math.log(len(evidence))
        against_lost = np.minimum(against_lost, most + (against_lost - most) / 50)
        again, anew = (min(weight, novelty / NOVEL) for weight in (AGAIN, 1))
        likelihood = Likelihood(np.exp(again * against_lost), np.exp(anew * against_lost))
        before = self.state
        moved = initial(PRIOR, len(evidence)) if before is None else self.moved(before, step)
        self.state = update(moved, likelihood)
        if before is not None and novelty > 0 and moved.came[0].sum() > 0:
            self.learn(before, moved, against_lost + lost_evidence, novelty)
        self.filtered.append(self.state)
        self.steps.append(step)
        self.likelihoods.append(likelihood)
        self.last = frame

    def step(self, length: float | None) -> Step:
        chances = step_chances()
        change = np.array([1 / (PERSISTENCE if speed > 0 else STOP) for speed in SPEEDS])
        if length is None:
            every = np.ones((len(SPEEDS), len(self.places)))
            return Step(
                self.prior(), PRIOR, change, chances, self.ways, every, np.ones(len(SPEEDS)), 1.0
            )
        walked = max(length, self.stationary)
        likelihood = student(walked - np.array([self.expected(speed) for speed in SPEEDS]))
        lost_likelihood = likelihood[:, self.some].mean(axis=1)
        there = [(place - len(self.places) // 2) % len(self.places) for place in self.some]
        jumps = np.linalg.norm(self.places[self.some] - self.places[there], axis=1)
        jump = float(student(length - jumps).mean())
        return Step(
            self.prior(), PRIOR, change, chances, self.ways, likelihood, lost_likelihood, jump
        )

    def moved(self, before: State, step: Step | OdometryStep) -> Predicted:
        return step.predict(before) if isinstance(step, OdometryStep) else predict(before, step)

    def odometry_step(self, length: float | None, displacement: Displacement) -> OdometryStep:
        assert self.route is not None
        count, pace = len(self.places), displacement.pace / self.route.spacing
        chances = np.zeros((2, count, count))
        for place in range(count):
            arrived = np.zeros((2, 2, count), np.float32)
            carry(
                np.array([place], np.int32),
                np.ones((1, 2), np.float32),
                self.roads,
                displacement,
                0,
                arrived,
            )
            chances[:, place] = arrived.sum(axis=0)
        likelihood, lost_likelihood, jump = np.ones(count), 1.0, 1.0
        if length is not None and pace <= 6 and displacement.is_measured:
            likelihood = student(max(length, self.stationary) - self.expected(pace))
            lost_likelihood = float(likelihood[self.some].mean())
            jump = self.step(length).jump
        return OdometryStep(speeds_of(pace), chances, likelihood, lost_likelihood, jump)

    def expected(self, speed: float) -> Points:
        """Return the length of a step at a speed, by the place that it leads to."""
        if speed < 1:
            one = np.maximum(self.apart[0], self.stationary)
            return np.asarray(self.stationary + (one - self.stationary) * math.sqrt(speed))
        low = math.floor(speed)
        shorter, longer = self.apart[min(low, 6) - 1], self.apart[min(low, 5)]
        return np.maximum(shorter + (speed - low) * (longer - shorter), self.stationary)

    def prior(self) -> Points:
        count = self.speeds.sum()
        learned = 0.8 * count / (count + 10)
        learned_speeds = self.speeds / count if count > 0 else PRIOR
        return np.asarray((1 - learned) * PRIOR + learned * learned_speeds)

    def observe(self, frame: Points | None, length: float | None) -> tuple[float, Points, float]:
        """Return the novelty, the log likelihood at each place, and the evidence when lost."""
        nothing = np.zeros(len(self.places))
        if frame is None:
            return 0.0, nothing, 0.0
        distances = ((self.places - frame) ** 2).sum(axis=1)
        if math.isclose(distances.var(), 0, abs_tol=1e-12):
            return 0.0, nothing, 0.0
        self.deviations = FORGET * self.deviations + distances.std()
        self.deviation_weight = FORGET * self.deviation_weight + 1
        novelty = 1.0 if length is None else min(1.0, length / self.typical)
        around = [distances[max(j - 1, 0) : j + 2].min() for j in range(len(distances))]
        near = (distances + around) / 2
        deviation = self.deviations / self.deviation_weight
        evidence = -NATS_PER_DEVIATION * (near - near.min()) / deviation
        mean_evidence = (self.evidence + 1.5 * 10) / (self.weight + 10)
        return novelty, evidence, max(0.75, LOST_FRACTION * mean_evidence)

    def learn(self, before: State, moved: Predicted, odds: Points, novelty: float) -> None:
        """Learn, given the log odds of the frame at each place to that at an average one."""
        assert self.state is not None
        expected = (moved.stayed[0] + moved.came[0]).sum(axis=0)
        ratio = float(expected @ np.exp(odds) / expected.sum())
        was_on_map = float(before.placed[0].sum())
        nats = math.log(max(ratio, 1e-6))
        self.evidence = FORGET * self.evidence + was_on_map * novelty * nats
        self.weight = FORGET * self.weight + was_on_map * novelty
        self.speeds = FORGET * self.speeds + self.state.placed[0].sum(axis=1)

    def belief(self) -> Points:
        """Posterior of each place on the map, (K,), at a speed that it resolves."""
        assert self.state is not None
        return np.asarray(self.state.placed[0, :RESOLVED].sum(axis=0))

    def smoothed(self) -> list[Points | None]:
        """Posterior of each place, (K,), at each frame, given all; None before an observation."""
        if not self.filtered:
            return [None] * len(self.frames)
        states = self.smooth()
        return [
            None if frame is None else np.asarray(states[frame].placed[0, :RESOLVED].sum(axis=0))
            for frame in self.frames
        ]

    def smooth(self) -> list[State]:
        """Smooth as the textbook does, over steps of both kinds."""
        last = self.filtered[-1]
        backward, smoothed = State(np.ones_like(last.placed), np.ones_like(last.lost)), [last]
        for frame in range(len(self.filtered) - 1, 0, -1):
            step, likelihood = self.steps[frame], self.likelihoods[frame]
            if isinstance(step, OdometryStep):
                backward = step.predict_backward(backward, likelihood)
            else:
                backward = predict_backward(backward, step, likelihood)
            before = self.filtered[frame - 1]
            both = State(before.placed * backward.placed, before.lost * backward.lost)
            smoothed.append(both.normalised())
        return smoothed[::-1]


def student(difference: Points | float) -> Points:
    return np.asarray((1 + (difference / STEP_DEVIATION) ** 2 / 2) ** -1.5)


@cache
def step_chances() -> Points:
    """Return the chances of steps (S, 1 + REACH): means over the speeds that each represents."""
    widths = [0, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 8, 1 / 8, 1 / 8, 1 / 8, 1 / 4]
    widths += [1 / 2, 1 / 2, 1 / 2, 1 / 2, 1 / 2, 1 / 2, 1, 1]
    around = np.array(SPEEDS)[:, None] + np.array(widths)[:, None] * np.linspace(-1, 1, 201)
    steps = np.arange(REACH + 1)
    return np.asarray(np.maximum(1 - abs(around[:, None] - steps[:, None]), 0).mean(axis=2))
