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

import math
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from placefield.matching.comparing import Comparison
from placefield.matching.filter_step import (
    Motion,
    Steps,
    advance,
    believed,
    exponents_of,
    step_length,
)
from placefield.metric.codes import Codes

Array = NDArray[np.float32]
Rows = TypeVar("Rows", bound=NDArray[np.generic])

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
_UNSEEN = -1.0  # length of a step of which nothing is known
_SAMPLE = 1000  # places that stand for all where only a mean is wanted


class PlaceFilter:
    """The belief in every place, given the frames so far; ``begun`` once one was seen."""

    def __init__(self, steps: Array, jumps: Array, persistence: float) -> None:
        """Prepare for a new stream.

        Args:
            steps: (2, K) float32, how far each place is from the one before it, and from the one
                before that.
            jumps: (J,) float32, how far places are from others that have nothing to do with them.
            persistence: how many frames a speed lasts, on average.
        """
        typical = float(np.median(steps[0]))
        self._typical_step = typical if typical > 0 else 1.0
        standing = _NOISE * self._typical_step
        arriving = np.maximum(steps, np.float32(standing))
        some = evenly_spaced(arriving.T).T.copy()
        self._steps = Steps(arriving, some, jumps, standing, _STEP_DEVIATION)
        self._motion = _motion(persistence, steps.shape[1])
        # Beliefs are (sheets, speeds, places): the map first, then the decoy. They are kept as they
        # come, together with their sum.
        self._belief = np.empty((2, len(SPEEDS), steps.shape[1]), np.float32)
        self._belief[:] = self._motion.anywhere[:, :, None]
        self._of_place = self._belief[0].sum(axis=0)
        self._lost, self._total = 1.0, 2.0
        self._last: Codes | None = None
        self.begun = False

    def push(self, frame: Comparison) -> None:
        """Take the next frame."""
        step, novelty = _UNSEEN, 1.0
        if self._last is not None:
            step = step_length(frame.codes, self._last, frame.metric.unit)
            # A frame like the last one says again what that has said.
            novelty = min(1.0, step / self._typical_step)
        likelihood, lost_evidence = _see(frame, novelty)
        if self.begun:
            self._advance(step, likelihood, lost_evidence)
        else:
            self._begin(likelihood, lost_evidence)
        self._last = frame.codes

    def push_unseen(self) -> None:
        """Take a frame that was not seen: the vehicle has moved on all the same."""
        if self.begun:
            self._advance(_UNSEEN, np.ones_like(self._of_place), 1.0)
        self._last = None

    @property
    def belief(self) -> Array:
        """Probability of each place, (K,); what is missing to 1 is that of being nowhere on it."""
        return np.asarray(self._of_place / self._total, np.float32)

    def believed(self, least: float) -> tuple[int, NDArray[np.int32], Array]:
        """Return the index of the best place among all of at least this probability, these, theirs.

        Places ascend, and the best is among them in any case.
        """
        places, beliefs = np.empty(len(self._of_place), np.int32), np.empty_like(self._of_place)
        count, best = believed(self._of_place, 1 / self._total, least, places, beliefs)
        return best, places[:count].copy(), beliefs[:count].copy()

    def _begin(self, likelihood: Array, lost_evidence: float) -> None:
        self._belief *= likelihood
        self._of_place = self._belief[0].sum(axis=0)
        self._lost *= lost_evidence * float(likelihood.mean(dtype=np.float64))
        self._total = float(self._belief.sum(dtype=np.float64)) + self._lost
        self.begun = True

    def _advance(self, step: float, likelihood: Array, lost_evidence: float) -> None:
        self._lost, self._total = advance(
            self._belief,
            self._lost,
            self._total,
            self._motion,
            self._steps,
            step,
            likelihood,
            lost_evidence,
            self._of_place,
        )


def evenly_spaced(rows: Rows) -> Rows:
    """Return at most ``_SAMPLE`` of the rows, evenly spaced, to stand for all of them."""
    return cast(Rows, rows[:: -(-len(rows) // _SAMPLE)])


def _see(frame: Comparison, novelty: float) -> tuple[Array, float]:
    """Return the likelihood of what is seen at each place, (K,): the nearer, the likelier.

    And how many times likelier than at the average place it is when lost.
    """
    exponents = np.empty(len(frame.distances), np.float32)
    if frame.deviation == 0:
        return np.ones_like(exponents), 1.0
    exponents_of(frame.distances, novelty / frame.deviation, exponents)
    return np.exp(exponents, out=exponents), math.exp(novelty * _LOST_EVIDENCE)


def _step_chances() -> NDArray[np.float64]:
    """Chance of each step at each speed, (speeds, steps): between two steps, the nearer oftener."""
    exact = np.maximum(1 - np.abs(SPEEDS[:, None] - np.array(STEPS)), 0)
    return np.asarray((1 - _SLIP) * exact + _SLIP / len(STEPS))


def _motion(persistence: float, places: int) -> Motion:
    lasts = np.maximum(np.where(SPEEDS > 0, persistence, _STOP), 1)
    return Motion(
        (1 / lasts).astype(np.float32),
        _SPEED_PRIOR.astype(np.float32),
        _step_chances().astype(np.float32),
        (_SHEETS[:, None] * _SPEED_PRIOR / places).astype(np.float32),
        _LOSE,
        _FIND,
    )
