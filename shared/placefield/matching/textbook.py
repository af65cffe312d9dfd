"""The textbook version of the filter and its smoother, to read, and for tests to compare with.

It is a hidden Markov model with the states (hypothesis, speed, place) and (lost, speed). There are
no shards, no pruning and no compiled loops; numbers are float64. A step of several places is as
many steps of one place, all by one transition matrix, which is sparse. The observation of a frame
is given as its likelihood at every place, relative to that when lost, and the step from the frame
before has a likelihood of its own. A frame counts for less where the vehicle already was than where
it has just come to.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from placefield.maps.route_graph import RouteGraph
from placefield.matching.motion import FIND, HYPOTHESES, LOSE

Array = NDArray[np.float64]
Places = NDArray[np.int32]
Ways = tuple[csr_array[np.float64], csr_array[np.float64]]


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


def ways_of(graph: RouteGraph, count: int) -> Ways:
    """Return the transition matrices of a step of one place, see ``Step``.

    A vehicle takes each way from a place with the same chance, in reverse as well.
    """
    left, arrived = graph.edges(count).T
    return _transition(left, arrived, count), _transition(arrived, left, count)


def _transition(left: Places, arrived: Places, count: int) -> csr_array[np.float64]:
    chances = 1 / np.bincount(left, minlength=count)[left]
    return csr_array((chances, (left, arrived)), shape=(count, count))


class Step(NamedTuple):
    """The transition to a frame, and the likelihood of the observed step.

    Attributes:
        prior: (S,), of each speed after a change, on the map.
        unlearned: (S,), the same when lost.
        change: (S,), chance of a change.
        chances: (S, R), of a step of 0, 1, … places at each speed.
        ways: chance of a step of one place from each place to each, (K, K), on the map and on its
            reverse.
        likelihood: (S, K), of the observed step, at each speed, by the place that it leads to.
        lost_likelihood: (S,), the same when lost.
        jump: the same from a place to lost.
    """

    prior: Array
    unlearned: Array
    change: Array
    chances: Array
    ways: Ways
    likelihood: Array
    lost_likelihood: Array
    jump: float


def _anywhere(by_speed: Array, places: int) -> Array:
    """Return the distribution of a vehicle that may be anywhere, (2, S, K)."""
    anywhere = HYPOTHESES[:, None, None] * by_speed[:, None] / places
    return np.broadcast_to(anywhere, (2, len(by_speed), places))


class Predicted(NamedTuple):
    """The prediction for a frame, before the update.

    Attributes:
        stayed: (2, S, K), at the place of the frame before.
        came: (2, S, K), at another place.
        lost: (S,).
    """

    stayed: Array
    came: Array
    lost: Array


def initial(prior: Array, places: int) -> Predicted:
    """Return the prediction for the first frame: lost or anywhere, with equal probability."""
    came = 0.5 * _anywhere(prior, places)
    return Predicted(np.zeros_like(came), came, 0.5 * prior)


class Likelihood(NamedTuple):
    """The likelihood of a frame, relative to that when lost.

    Attributes:
        again: (K,), for a vehicle that has stayed at a place.
        anew: (K,), for one that has come there.
    """

    again: Array
    anew: Array


def predict(state: State, step: Step) -> Predicted:
    """Predict the distribution at the next frame, weighted by the observed step."""
    changed = np.einsum("s,hsk->hk", step.change, state.placed)
    mixed = (1 - step.change)[:, None] * state.placed
    mixed = mixed + step.prior[:, None] * changed[:, None]
    came, moving, count = np.zeros_like(mixed), mixed, mixed.shape[2]
    for chance in step.chances[:, 1:].T:
        moving = np.stack([each @ ways for each, ways in zip(moving, step.ways, strict=True)])
        came += chance[:, None] * moving
    change = step.change
    still_lost = step.lost_likelihood * (
        (1 - change) * state.lost + step.unlearned * (change @ state.lost)
    )
    left = LOSE * step.jump * float(state.placed.sum()) * step.unlearned
    found = _anywhere(FIND * still_lost, count)
    kept = (1 - LOSE) * step.likelihood
    return Predicted(
        kept * step.chances[:, 0, None] * mixed, kept * came + found, (1 - FIND) * still_lost + left
    )


def update(predicted: Predicted, likelihood: Likelihood) -> State:
    """Update a prediction by a frame."""
    placed = predicted.stayed * likelihood.again + predicted.came * likelihood.anew
    return State(placed, predicted.lost).normalised()


def smooth(
    filtered: Sequence[State], steps: Sequence[Step], likelihoods: Sequence[Likelihood]
) -> list[State]:
    """Return the distribution at each frame given all of them (forward-backward).

    Args:
        filtered: at each frame, given those up to it.
        steps: to each frame; the first is not used.
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
    """Move the backward message from a frame to the frame before it.

    Args:
        backward: likelihood of all later frames given each state at the frame.
        step: to the frame, see ``predict``.
        likelihood: of the frame, see ``update``.
    """
    count = backward.placed.shape[2]
    anew = backward.placed * likelihood.anew
    found = (_anywhere(np.ones_like(backward.lost), count) * anew).sum(axis=(0, 2))
    still_lost = step.lost_likelihood * ((1 - FIND) * backward.lost + FIND * found)
    lost = still_lost + step.change * (step.unlearned @ still_lost - still_lost)
    stayed = step.likelihood * backward.placed * likelihood.again
    message = step.likelihood * anew
    reached = step.chances[:, 0, None] * stayed
    for chance in step.chances[:, 1:].T:
        message = np.stack([each @ ways.T for each, ways in zip(message, step.ways, strict=True)])
        reached += chance[:, None] * message
    mixed = np.einsum("s,hsk->hk", step.prior, reached)
    change = step.change[:, None]
    kept = (1 - change) * reached + change * mixed[:, None]
    placed = (1 - LOSE) * kept + LOSE * step.jump * (step.unlearned @ backward.lost)
    top = max(float(placed.max()), float(lost.max()))
    return State(placed / top, lost / top)
