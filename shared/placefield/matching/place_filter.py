"""The rule ``filter``: a forward filter over place and speed, that copes with any speed.

The vehicle is at a place and moves at a speed, or it is lost: on no place of the map, or on one
that it has jumped to. From each query frame to the next it takes a step of 0, 1 or 2 places, as its
speed has it. Two things are seen of it. How far the query frame is from every place, in descriptor
space, tells the place. How far it is from the query frame before, compared with how far the places
are from each other, tells the step; since both frames of that pair are of one traverse, light and
season are out of it. The belief in every place given all frames so far follows by Bayes' rule, at a
cost per frame that is linear in the places.

Frames of another route resemble some place or other, and those after them its neighbours: by chance
they follow the map for a while. So the map competes with a decoy: the same places in reverse order.
It is as good a match for strangers, but not for who drives the route.
"""

import numpy as np
from numpy.typing import NDArray

from placefield.matching.distances import PlaceDistances

Array = NDArray[np.float64]

SPEEDS = np.array([0.0, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0])
"""Places per frame."""

STEPS = (0, 1, 2)
"""Places that the vehicle may advance from one frame to the next."""

_SPEED_PRIOR = np.array([1.0, 1.0, 1.0, 4.0, 1.0, 1.0, 1.0]) / 10
_STOP = 5.0  # frames that a stop lasts
_SLIP = 0.05  # share of steps that the speed does not explain
_LOSE = 0.003  # chance that a vehicle that is on the map is lost at the next frame
_FIND = 0.2  # chance that one that is lost is on the map at the next frame
_SHEETS = np.array([0.2, 0.8])  # of which that the map has, and the decoy
_STEP_DEVIATION = 0.3  # between the lengths of a step in two traverses; descriptors have length 1
_NOISE = 0.05  # share of a typical step that the frames of a standing camera differ by
_LOST_EVIDENCE = 0.75  # that chance gives a frame for the best of places over an average one, nats


class PlaceFilter:
    """The belief in every place, given the frames so far; ``begun`` once one was seen."""

    def __init__(self, distances: PlaceDistances, persistence: float) -> None:
        """Prepare for a new stream.

        Args:
            distances: the places, under the channel's metric.
            persistence: how many frames a speed lasts, on average.
        """
        places = distances.places.astype(np.float64)
        # Arrays of belief are (sheets, speeds, places): the map first, then the decoy.
        self._step_lengths = np.stack([_step_lengths(places), _step_lengths(places[::-1])])
        self._jump_lengths = np.linalg.norm(places - np.roll(places, len(places) // 2, 0), axis=1)
        typical = np.median(self._step_lengths[0, 1])
        self._typical_step = float(typical) if typical > 0 else 1.0
        self._floor = _NOISE * self._typical_step
        self._step_lengths = np.maximum(self._step_lengths, self._floor)
        lasts = np.where(SPEEDS > 0, persistence, _STOP)[:, None]
        self._change = 1 / np.maximum(lasts, 1)
        self._anywhere = _SHEETS[:, None, None] * _SPEED_PRIOR[:, None] / len(places)
        self._belief = 0.5 * np.broadcast_to(self._anywhere, (2, len(SPEEDS), len(places)))
        self._lost = 0.5
        self._last: NDArray[np.float32] | None = None
        self.begun = False

    def push(self, projected: NDArray[np.float32], distances: NDArray[np.float32]) -> None:
        """Take the next frame.

        Args:
            projected: (M,) float32, its descriptor under the channel's metric.
            distances: (K,) float32, its squared distances to the places.
        """
        novelty = 1.0
        if self._last is not None:
            step_length = float(np.linalg.norm(projected.astype(np.float64) - self._last))
            # A frame like the last one says again what that has said.
            novelty = min(1.0, step_length / self._typical_step)
            jump_likelihood = float(_student(step_length - self._jump_lengths).mean())
            self._move(
                _student(max(step_length, self._floor) - self._step_lengths), jump_likelihood
            )
        elif self.begun:
            self._move_unseen()
        self._see(distances, novelty)
        self._last = projected
        self.begun = True

    def push_unseen(self) -> None:
        """Take a frame that was not seen: the vehicle has moved on all the same."""
        if self.begun:
            self._move_unseen()
        self._last = None

    @property
    def belief(self) -> Array:
        """Probability of each place, (K,); what is missing to 1 is that of being nowhere on it."""
        return np.asarray(self._belief[0].sum(axis=0))

    def _move_unseen(self) -> None:
        self._move(np.ones_like(self._step_lengths), 1.0)

    def _move(self, step_likelihood: Array, jump_likelihood: float) -> None:
        """Predict: keep or change speed, step on, be lost or found.

        ``step_likelihood`` (sheets, steps, places) is of arriving at a place by a step.
        """
        changing = self._change * self._belief
        changed = _SPEED_PRIOR[:, None] * changing.sum(axis=1, keepdims=True)
        belief = self._belief - changing + changed
        moved = np.zeros_like(belief)
        places = belief.shape[2]
        for number, step in enumerate(STEPS):
            chance = _STEP_CHANCES[:, number, None]
            arriving = belief[:, :, : max(places - step, 0)]
            moved[:, :, step:] += chance * arriving * step_likelihood[:, number, None, step:]
        stray = self._lost * float(_SPEED_PRIOR @ _STEP_CHANCES @ step_likelihood[0].mean(axis=1))
        jumping = jump_likelihood * float(belief.sum())
        self._belief = (1 - _LOSE) * moved + _FIND * stray * self._anywhere
        self._lost = (1 - _FIND) * stray + _LOSE * jumping
        self._normalise()

    def _see(self, distances: NDArray[np.float32], novelty: float) -> None:
        """Correct: weigh every place by how near it is, being lost by the average place."""
        deviation = distances.std(dtype=np.float64)
        if deviation == 0:
            return
        # Relative to the nearest place, so that no likelihood overflows and not all vanish.
        likelihood = np.exp(novelty / deviation * (distances.min() - distances.astype(np.float64)))
        self._belief *= np.stack([likelihood, likelihood[::-1]])[:, None]
        self._lost *= float(likelihood.mean()) * np.exp(novelty * _LOST_EVIDENCE)
        self._normalise()

    def _normalise(self) -> None:
        total = float(self._belief.sum()) + self._lost
        self._belief /= total
        self._lost /= total


def _step_chances() -> Array:
    """Chance of each step at each speed, (speeds, steps): between two steps, the nearer oftener."""
    exact = np.maximum(1 - np.abs(SPEEDS[:, None] - np.array(STEPS)), 0)
    return np.asarray((1 - _SLIP) * exact + _SLIP / len(STEPS))


_STEP_CHANCES = _step_chances()


def _step_lengths(places: Array) -> Array:
    """Distance of each place to the one so many steps before it, (steps, K)."""
    lengths = np.zeros((len(STEPS), len(places)))
    for step in STEPS[1:]:
        apart = np.linalg.norm(places[step:] - places[:-step], axis=1)
        lengths[step, step:] = apart
        lengths[step, :step] = apart.mean() if len(apart) else 0
    return lengths


def _student(differences: Array) -> Array:
    """Density of Student's t with 2 degrees of freedom, up to a factor: it forgives outliers."""
    return np.asarray((1 + (differences / _STEP_DEVIATION) ** 2 / 2) ** -1.5)
