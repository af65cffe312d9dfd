"""The textbook's filter and smoother against sums over all ways that a vehicle can have gone."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.maps.route_graph import NO_LINKS, RouteGraph
from placefield.matching.motion import FIND, HYPOTHESES, LOSE
from placefield.matching.textbook import (
    Likelihood,
    State,
    Step,
    initial,
    predict,
    smooth,
    update,
    ways_of,
)

PLACES, SPEEDS = 3, 2
PLACED = [*itertools.product(range(2), range(SPEEDS), range(PLACES))]
STATES: list[tuple[int, ...]] = [*PLACED, *((speed,) for speed in range(SPEEDS))]
"""The second ones are lost."""
Chain = tuple[list[Step], list[Likelihood], RouteGraph]
GRAPHS = [
    RouteGraph(("a", "b")[: len(first)], np.array(first, np.int32), np.array(links, np.int32))
    for first, links in (
        ([0], NO_LINKS),
        ([0, 1], NO_LINKS),
        ([0], [[2, 0]]),
        ([0], [[0, 2], [1, 1]]),
        ([0, 2], [[0, 2], [1, 2], [2, 1]]),
    )
]


@st.composite
def chains(draw: st.DrawFn) -> Chain:
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    frames, graph = draw(st.integers(1, 4)), draw(st.sampled_from(GRAPHS))
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
                ways_of(graph, PLACES),
                rng.random((SPEEDS, PLACES)),
                rng.random(SPEEDS),
                rng.random(),
            )
        )
        likelihoods.append(Likelihood(rng.random(PLACES), rng.random(PLACES)))
    return steps, likelihoods, graph


def chance_of_way(graph: RouteGraph, places: tuple[int, ...], *, reverse: bool) -> float:
    """Of a way along these places, for a vehicle that takes so many steps."""
    steps = [(place, place + 1) for place in range(PLACES - 1) if place + 1 not in graph.first]
    steps += [(int(left), int(arrived)) for left, arrived in graph.links]
    steps = [(arrived, left) for left, arrived in steps] if reverse else steps
    chance = 1.0
    for left, arrived in itertools.pairwise(places):
        ways = [each for start, each in steps if start == left]
        chance *= (arrived in ways) / max(len(ways), 1)
    return chance


def likelihood_of_moving(
    before: tuple[int, ...],
    after: tuple[int, ...],
    step: Step,
    likelihood: Likelihood,
    graph: RouteGraph,
) -> float:
    """Of one state from another, of the step and of the frame after it.

    A frame counts for less if the vehicle stayed, but not if it came back on a circuit.
    """
    if len(before) == 1:
        speed = after[0] if len(after) == 1 else after[1]
        drifts = (
            change_of_speed(before[0], speed, step, step.unlearned) * step.lost_likelihood[speed]
        )
        if len(after) == 1:
            return float(drifts * (1 - FIND))
        return float(drifts * FIND * HYPOTHESES[after[0]] / PLACES * likelihood.anew[after[2]])
    if len(after) == 1:
        return float(LOSE * step.jump * step.unlearned[after[0]])
    if before[0] != after[0]:
        return 0
    chance = (before[2] == after[2]) * step.chances[after[1], 0] * likelihood.again[after[2]]
    for steps in (1, 2):
        for between in itertools.product(range(PLACES), repeat=steps - 1):
            way = (before[2], *between, after[2])
            taken = chance_of_way(graph, way, reverse=bool(after[0]))
            chance += step.chances[after[1], steps] * taken * likelihood.anew[after[2]]
    speeds = change_of_speed(before[1], after[1], step, step.prior)
    return float((1 - LOSE) * speeds * chance * step.likelihood[after[1], after[2]])


def change_of_speed(before: int, after: int, step: Step, prior: NDArray[np.float64]) -> float:
    change = step.change[before]
    return float(change * prior[after] + (1 - change) * (before == after))


def of_state(distribution: State, state: tuple[int, ...]) -> float:
    return float(distribution.placed[state] if len(state) == 3 else distribution.lost[state])


def likelihood_at(state: tuple[int, ...], likelihood: Likelihood) -> float:
    """Of the first frame in a state."""
    return float(likelihood.anew[state[2]]) if len(state) == 3 else 1.0


def posteriors_by_enumeration(chain: Chain, frames: int) -> list[dict[tuple[int, ...], float]]:
    """Of every state at each of the first frames, given these."""
    steps, likelihoods, graph = chain
    start = initial(steps[0].prior, PLACES)
    first = State(start.came, start.lost)
    ways: dict[tuple[tuple[int, ...], ...], float] = {
        (state,): of_state(first, state) * likelihood_at(state, likelihoods[0]) for state in STATES
    }
    for frame in range(1, frames):
        ways = {
            (*way, state): weight
            * likelihood_of_moving(way[-1], state, steps[frame], likelihoods[frame], graph)
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
    steps, likelihoods, _ = chain
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
