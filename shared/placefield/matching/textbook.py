"""The filter and its smoother as a textbook has them: a page to read, and what tests compare with.

A hidden Markov model with the states (hypothesis, speed, place) and (lost, speed). Here nothing is
cut into shards, nothing left out and nothing compiled; arrays are dense and float64. What a frame
is observed to be is given as its likelihood at every place, in terms of that when lost, and that of
the step from the frame before by itself. Where the vehicle was already, a frame tells less than
where it has just come to.
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
        lost: (S,), of being on none, at each speed.
    """

    placed: Array
    lost: Array

    def normalised(self) -> "State":
        """Return it with sum 1."""
        total = float(self.placed.sum() + self.lost.sum())
        return State(self.placed / total, self.lost / total)


class Step(NamedTuple):
    """The transition to a frame, and how likely the observed step is.

    Attributes:
        prior: (S,), of each speed after a change, on the map.
        unlearned: (S,), the same when lost.
        change: (S,), chance of a change.
        chances: (S, R), of a step of 0, 1, … places at each speed.
        likelihood: (S, K), of the observed step, at each speed, by the place that it leads to.
        lost_likelihood: (S,), the same when lost.
        jump: the same from a place to lost.
    """

    prior: Array
    unlearned: Array
    change: Array
    chances: Array
    likelihood: Array
    lost_likelihood: Array
    jump: float


def _anywhere(of_speed: Array, places: int) -> Array:
    """Return the distribution of a vehicle that may be anywhere, (2, S, K)."""
    anywhere = HYPOTHESES[:, None, None] * of_speed[:, None] / places
    return np.broadcast_to(anywhere, (2, len(of_speed), places))


class Predicted(NamedTuple):
    """Where a vehicle may be before a frame is looked at.

    Attributes:
        stayed: (2, S, K), at the place of the frame before.
        came: (2, S, K), at another.
        lost: (S,).
    """

    stayed: Array
    came: Array
    lost: Array


def initial(prior: Array, places: int) -> Predicted:
    """Return the distribution before the first frame: lost or anywhere, as likely."""
    came = 0.5 * _anywhere(prior, places)
    return Predicted(np.zeros_like(came), came, 0.5 * prior)


class Likelihood(NamedTuple):
    """How likely a frame is, in terms of that when lost.

    Attributes:
        again: (K,), for a vehicle that has stayed at a place.
        anew: (K,), for one that has come there.
    """

    again: Array
    anew: Array


def predict(state: State, step: Step) -> Predicted:
    """Move a distribution on by a frame, weighed by the observed step."""
    changed = np.einsum("s,hsk->hk", step.change, state.placed)
    mixed = (1 - step.change)[:, None] * state.placed
    mixed = mixed + step.prior[:, None] * changed[:, None]
    came = np.zeros_like(mixed)
    count = came.shape[2]
    for places in range(1, min(step.chances.shape[1], count)):
        chance = step.chances[:, places, None]
        came[0, :, places:] += chance * mixed[0, :, : count - places]
        came[1, :, : count - places] += chance * mixed[1, :, places:]
    change = step.change
    adrift = step.lost_likelihood * (
        (1 - change) * state.lost + step.unlearned * (change @ state.lost)
    )
    left = LOSE * step.jump * float(state.placed.sum()) * step.unlearned
    found = _anywhere(FIND * adrift, count)
    kept = (1 - LOSE) * step.likelihood
    return Predicted(
        kept * step.chances[:, 0, None] * mixed, kept * came + found, (1 - FIND) * adrift + left
    )


def update(predicted: Predicted, likelihood: Likelihood) -> State:
    """Condition a prediction on a frame."""
    placed = predicted.stayed * likelihood.again + predicted.came * likelihood.anew
    return State(placed, predicted.lost).normalised()


def smooth(
    filtered: Sequence[State], steps: Sequence[Step], likelihoods: Sequence[Likelihood]
) -> list[State]:
    """Return the distribution at each frame given all of them (forward-backward).

    Args:
        filtered: at each frame, given those up to it.
        steps: to each frame; the first is not looked at.
        likelihoods: of each frame.
    """
    backward = State(np.ones_like(filtered[-1].placed), np.ones_like(filtered[-1].lost))
    smoothed = [filtered[-1]]
    for frame in range(len(filtered) - 1, 0, -1):
        backward = predict_backward(backward, steps[frame], likelihoods[frame])
        before = filtered[frame - 1]
        both = State(before.placed * backward.placed, before.lost * backward.lost)
        smoothed.append(both.normalised())
    return smoothed[::-1]


def predict_backward(backward: State, step: Step, likelihood: Likelihood) -> State:
    """Return how likely a frame and what follows are from each state before it.

    Args:
        backward: how likely what follows is from each state at the frame.
        step: to the frame, see ``predict``.
        likelihood: of the frame, see ``update``.
    """
    count = backward.placed.shape[2]
    anew = backward.placed * likelihood.anew
    found = (_anywhere(np.ones_like(backward.lost), count) * anew).sum(axis=(0, 2))
    adrift = step.lost_likelihood * ((1 - FIND) * backward.lost + FIND * found)
    lost = adrift + step.change * (step.unlearned @ adrift - adrift)
    stayed = step.likelihood * backward.placed * likelihood.again
    ahead = step.likelihood * anew
    reached = step.chances[:, 0, None] * stayed
    for places in range(1, min(step.chances.shape[1], count)):
        chance = step.chances[:, places, None]
        reached[0, :, : count - places] += chance * ahead[0, :, places:]
        reached[1, :, places:] += chance * ahead[1, :, : count - places]
    mixed = np.einsum("s,hsk->hk", step.prior, reached)
    change = step.change[:, None]
    kept = (1 - change) * reached + change * mixed[:, None]
    placed = (1 - LOSE) * kept + LOSE * step.jump * (step.unlearned @ backward.lost)
    top = max(float(placed.max()), float(lost.max()))
    return State(placed / top, lost / top)
