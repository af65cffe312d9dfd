"""The textbook's filter and smoother against sums over all ways that a vehicle can have gone."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.matching.motion import FIND, HYPOTHESES, LOSE
from placefield.matching.textbook import (
    Likelihood,
    State,
    Step,
    initial,
    predict,
    smooth,
    update,
)

PLACES, SPEEDS = 3, 2
PLACED = [*itertools.product(range(2), range(SPEEDS), range(PLACES))]
STATES: list[tuple[int, ...]] = [*PLACED, *((speed,) for speed in range(SPEEDS))]
"""The second ones are lost."""
Chain = tuple[list[Step], list[Likelihood]]


@st.composite
def chains(draw: st.DrawFn) -> Chain:
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    frames = draw(st.integers(1, 4))
    steps, likelihoods = [], []
    for _ in range(frames):
        prior, unlearned = rng.random(SPEEDS), rng.random(SPEEDS)
        chances = rng.random((SPEEDS, 3))
        steps.append(
            Step(
                prior / prior.sum(),
                unlearned / unlearned.sum(),
                rng.random(SPEEDS),
                chances / chances.sum(axis=1, keepdims=True),
                rng.random((SPEEDS, PLACES)),
                rng.random(SPEEDS),
                rng.random(),
            )
        )
        likelihoods.append(Likelihood(rng.random(PLACES), rng.random(PLACES)))
    return steps, likelihoods


def probability_of_moving(before: tuple[int, ...], after: tuple[int, ...], step: Step) -> float:
    """Of one state from another, times how likely the step is."""
    if len(before) == 1:
        speed = after[0] if len(after) == 1 else after[1]
        drifts = (
            change_of_speed(before[0], speed, step, step.unlearned) * step.lost_likelihood[speed]
        )
        found = FIND * HYPOTHESES[after[0]] / PLACES if len(after) == 3 else 1 - FIND
        return float(drifts * found)
    if len(after) == 1:
        return float(LOSE * step.jump * step.unlearned[after[0]])
    if before[0] != after[0]:
        return 0
    step_places = after[2] - before[2] if after[0] == 0 else before[2] - after[2]
    chance = step.chances[after[1], step_places] if 0 <= step_places < 3 else 0.0
    speeds = change_of_speed(before[1], after[1], step, step.prior)
    return float((1 - LOSE) * speeds * chance * step.likelihood[after[1], after[2]])


def change_of_speed(before: int, after: int, step: Step, prior: NDArray[np.float64]) -> float:
    change = step.change[before]
    return float(change * prior[after] + (1 - change) * (before == after))


def of_state(distribution: State, state: tuple[int, ...]) -> float:
    return float(distribution.placed[state] if len(state) == 3 else distribution.lost[state])


def likelihood_at(
    state: tuple[int, ...], likelihood: Likelihood, before: tuple[int, ...] = ()
) -> float:
    """Of a frame in a state, given the one before."""
    if len(state) == 1:
        return 1.0
    was_there = len(before) == 3 and before[2] == state[2]
    return float((likelihood.again if was_there else likelihood.anew)[state[2]])


def posteriors_by_enumeration(chain: Chain, frames: int) -> list[dict[tuple[int, ...], float]]:
    """Of every state at each of the first frames, given these."""
    steps, likelihoods = chain
    start = initial(steps[0].prior, PLACES)
    first = State(start.came, start.lost)
    ways: dict[tuple[tuple[int, ...], ...], float] = {
        (state,): of_state(first, state) * likelihood_at(state, likelihoods[0]) for state in STATES
    }
    for frame in range(1, frames):
        ways = {
            (*way, state): weight
            * probability_of_moving(way[-1], state, steps[frame])
            * likelihood_at(state, likelihoods[frame], way[-1])
            for way, weight in ways.items()
            for state in STATES
            if weight > 0
        }
    total = sum(ways.values())
    posteriors: list[dict[tuple[int, ...], float]] = [
        dict.fromkeys(STATES, 0.0) for _ in range(frames)
    ]
    for way, weight in ways.items():
        for frame, state in enumerate(way):
            posteriors[frame][state] += weight / total
    return posteriors


@given(chains())
@settings(max_examples=25, deadline=None)
def test_filter_and_smoother_are_sums_over_all_ways(chain: Chain) -> None:
    steps, likelihoods = chain
    state = update(initial(steps[0].prior, PLACES), likelihoods[0])
    filtered = [state]
    for frame in range(1, len(steps)):
        filtered.append(update(predict(filtered[-1], steps[frame]), likelihoods[frame]))
    for frame, state in enumerate(filtered):
        expected = posteriors_by_enumeration(chain, frame + 1)[-1]
        for each in STATES:
            assert of_state(state, each) == pytest.approx(expected[each], rel=1e-9, abs=1e-15)
    in_hindsight = posteriors_by_enumeration(chain, len(steps))
    for state, expected in zip(smooth(filtered, steps, likelihoods), in_hindsight, strict=True):
        for each in STATES:
            assert of_state(state, each) == pytest.approx(expected[each], rel=1e-9, abs=1e-15)
