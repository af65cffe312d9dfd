"""The filter and its smoother as a textbook has them: a page to read, and what tests compare with.

A hidden Markov model with the states (hypothesis, speed, place) and *lost*. Here nothing is cut
into shards, nothing left out and nothing compiled; arrays are dense and float64. What a frame is
observed to be is given as its likelihood in every state, the step from the frame before included.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import FIND, HYPOTHESES, LOSE

Array = NDArray[np.float64]


class State(NamedTuple):
    """A distribution over the states.

    Attributes:
        placed: (2, S, K), of each place at each speed, on the map and on its reverse.
        lost: of being on none.
    """

    placed: Array
    lost: float

    def normalised(self) -> "State":
        """Return it with sum 1."""
        total = float(self.placed.sum()) + self.lost
        return State(self.placed / total, self.lost / total)


class Step(NamedTuple):
    """The transition to a frame, and how likely the observed step is.

    Attributes:
        prior: (S,), of each speed after a change.
        change: (S,), chance of a change.
        chances: (S, R), of a step of 0, 1, … places at each speed.
        likelihood: (S, K), of the observed step, at each speed, by the place that it leads to.
        stray: the same when lost.
        jump: the same from a place to lost.
    """

    prior: Array
    change: Array
    chances: Array
    likelihood: Array
    stray: float
    jump: float


def initial(prior: Array, places: int) -> State:
    """Return the initial distribution: lost or anywhere, as likely."""
    anywhere = HYPOTHESES[:, None, None] * prior[:, None] / places
    return State(0.5 * np.broadcast_to(anywhere, (2, len(prior), places)), 0.5)


def predict(state: State, step: Step) -> State:
    """Move a distribution on by a frame, weighed by the observed step."""
    changed = np.einsum("s,hsk->hk", step.change, state.placed)
    mixed = (1 - step.change)[:, None] * state.placed
    mixed = mixed + step.prior[:, None] * changed[:, None]
    moved = np.zeros_like(mixed)
    count = moved.shape[2]
    for places in range(min(step.chances.shape[1], count)):
        chance = step.chances[:, places, None]
        moved[0, :, places:] += chance * mixed[0, :, : count - places]
        moved[1, :, : count - places] += chance * mixed[1, :, places:]
    found = FIND * step.stray * state.lost * initial(step.prior, count).placed / 0.5
    lost = (1 - FIND) * step.stray * state.lost + LOSE * step.jump * float(state.placed.sum())
    return State((1 - LOSE) * moved * step.likelihood + found, lost)


def update(state: State, likelihood: Array, lost_likelihood: float) -> State:
    """Condition a distribution on a frame, given its likelihood at each place, (K,), and lost."""
    return State(state.placed * likelihood, state.lost * lost_likelihood).normalised()


def smooth(
    filtered: Sequence[State], steps: Sequence[Step], likelihoods: Sequence[tuple[Array, float]]
) -> list[State]:
    """Return the distribution at each frame given all of them (forward-backward).

    Args:
        filtered: at each frame, given those up to it.
        steps: to each frame; the first is not looked at.
        likelihoods: of each frame, at each place (K,) and lost.
    """
    backward = State(np.ones_like(filtered[-1].placed), 1.0)
    smoothed = [filtered[-1]]
    for frame in range(len(filtered) - 1, 0, -1):
        seen = update_likelihood(backward, *likelihoods[frame])
        backward = predict_backward(seen, steps[frame])
        before = filtered[frame - 1]
        both = State(before.placed * backward.placed, before.lost * backward.lost)
        smoothed.append(both.normalised())
    return smoothed[::-1]


def update_likelihood(backward: State, likelihood: Array, lost_likelihood: float) -> State:
    """Return how likely a frame and those after it are from each state at it."""
    return State(backward.placed * likelihood, backward.lost * lost_likelihood)


def predict_backward(seen: State, step: Step) -> State:
    """Return how likely what follows is from each state of the frame before; see ``predict``."""
    count = seen.placed.shape[2]
    anywhere = initial(step.prior, count).placed / 0.5
    lost = (1 - FIND) * step.stray * seen.lost + FIND * step.stray * float(
        (anywhere * seen.placed).sum()
    )
    ahead = seen.placed * step.likelihood
    reached = np.zeros_like(ahead)
    for places in range(min(step.chances.shape[1], count)):
        chance = step.chances[:, places, None]
        reached[0, :, : count - places] += chance * ahead[0, :, places:]
        reached[1, :, places:] += chance * ahead[1, :, : count - places]
    mixed = np.einsum("s,hsk->hk", step.prior, reached)
    change = step.change[:, None]
    kept = (1 - change) * reached + change * mixed[:, None]
    placed = (1 - LOSE) * kept + LOSE * step.jump * seen.lost
    top = max(float(placed.max()), lost)
    return State(placed / top, lost / top)
