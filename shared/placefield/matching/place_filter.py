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
from collections.abc import Sequence
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import sum_of
from placefield.matching.comparing import Comparison
from placefield.matching.filter_step import (
    REACH,
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
NO_BORDERS = np.zeros((2, len(SPEEDS), 0), np.float32)
_SAMPLE = 1000  # places that stand for all where only a mean is wanted


class Share(NamedTuple):
    """What a shard's places have of a frame, as far as the other shards need it.

    Attributes:
        nearest: squared distance of the nearest place.
        believed: sum of the beliefs in the places of map and decoy, in a unit of the shard's own.
        likelihood: sum of the places' likelihoods, in that unit.
        borders: (2, S, 2) float32, beliefs in it of the last two places in the map and of the first
            two in the decoy, from where the vehicle may leave the shard; (2, S, 0) of the only one.
    """

    nearest: int
    believed: float
    likelihood: float
    borders: Array


class _Sight(NamedTuple):
    """How likely what is seen is.

    Attributes:
        nearest: squared distance of the nearest place.
        sharpness: by how much the logarithm of the likelihood falls with squared distance.
        likelihood: (K,) float32, at each place, in terms of that at the nearest.
        lost: how many times likelier than at the average place it is when lost.
    """

    nearest: int
    sharpness: float
    likelihood: Array
    lost: float


class PlaceFilter:
    """The belief in every place, given the frames so far; ``begun`` once one was seen.

    These are the places of one shard, consecutive ones. A frame takes two halves: ``take`` it, and
    ``settle`` with what all shards have of it. All replicate the belief that the vehicle is lost.
    """

    def __init__(self, steps: Array, jumps: Array, persistence: float, own: slice) -> None:
        """Prepare for a new stream.

        Args:
            steps: (2, K) float32, how far each place is from the one before it, and from the one
                before that.
            jumps: (J,) float32, how far places are from others that have nothing to do with them.
            persistence: how many frames a speed lasts, on average.
            own: the shard's places of these K; at least two, if not all.
        """
        typical = float(np.median(steps[0]))
        self._typical_step = typical if typical > 0 else 1.0
        standing = _NOISE * self._typical_step
        self._all_places = steps.shape[1]
        self._motion = _motion(persistence, self._all_places)
        some = np.maximum(evenly_spaced(steps.T).T.copy(), np.float32(standing))
        arriving = np.maximum(steps[:, own.start : own.stop + REACH], np.float32(standing))
        self._steps = Steps(arriving, some, jumps, standing, _STEP_DEVIATION)
        # Beliefs are (sheets, speeds, places): the map first, then the decoy. They are kept as they
        # come, which is together with the sum of all, and in a unit, since likelihoods here are in
        # terms of that at the nearest place here, which may not be the nearest of all.
        self._belief = np.empty((2, len(SPEEDS), own.stop - own.start), np.float32)
        self._belief[:] = self._motion.anywhere[:, :, None]
        self._of_place = self._belief[0].sum(axis=0)
        self._outside = np.zeros((2, len(SPEEDS), REACH), np.float32)
        self._unit, self._lost, self._total = 1.0, 1.0, 2.0
        self._sight = _Sight(0, 0.0, self._of_place, 1.0)
        self._last: Codes | None = None
        self.begun = False

    def take(self, frame: Comparison) -> Share:
        """Take the next frame as far as it can be taken with no word of the other shards."""
        return self._share(*self._move(frame))

    def take_unseen(self) -> Share:
        """Take a frame that was not seen, likewise."""
        return self._share(*self._move_unseen())

    def settle(self, shares: Sequence[Share], own: int) -> None:
        """Take what all shards have of the frame, in the order of their places.

        Args:
            shares: of one shard after the other.
            own: which of them this one's is.
        """
        nearest = min(share.nearest for share in shares)
        units = [math.exp((nearest - share.nearest) * self._sight.sharpness) for share in shares]
        believed = likelihood = 0.0
        for unit, share in zip(units, shares, strict=True):
            believed += unit * share.believed
            likelihood += unit * share.likelihood
        self._weigh(believed, likelihood)
        self._unit = units[own]
        for sheet, neighbour in enumerate((own - 1, own + 1)):
            if 0 <= neighbour < len(shares):
                borders = shares[neighbour].borders[sheet]
                self._outside[sheet] = borders * (units[neighbour] / self._total)

    def _move(self, frame: Comparison) -> tuple[float, float]:
        """Move on to a frame; return the sum of beliefs in these places, and of likelihoods."""
        step, novelty = _UNSEEN, 1.0
        if self._last is not None:
            step = step_length(frame.codes, self._last, frame.metric.unit)
            # A frame like the last one says again what that has said.
            novelty = min(1.0, step / self._typical_step)
        self._last = frame.codes
        self._sight = _see(frame, novelty)
        if self.begun:
            return self._advance(step)
        self.begun = True
        return self._begin()

    def _move_unseen(self) -> tuple[float, float]:
        self._last = None
        if not self.begun:
            return 0.0, 0.0
        self._sight = _Sight(0, 0.0, np.ones_like(self._of_place), 1.0)
        return self._advance(_UNSEEN)

    def _begin(self) -> tuple[float, float]:
        self._belief *= self._sight.likelihood
        self._of_place = self._belief[0].sum(axis=0)
        return float(self._belief.sum(dtype=np.float64)), sum_of(self._sight.likelihood)

    def _advance(self, step: float) -> tuple[float, float]:
        believed, self._lost = advance(
            self._belief,
            self._unit,
            self._outside,
            self._lost,
            self._total,
            self._motion,
            self._steps,
            step,
            self._sight.likelihood,
            self._of_place,
        )
        return believed, sum_of(self._sight.likelihood)

    def _weigh(self, believed: float, likelihood: float) -> None:
        """Weigh being lost against all shards' beliefs, given their sum, and of likelihoods."""
        if self.begun:
            self._lost *= self._sight.lost * likelihood / self._all_places
            self._total = believed + self._lost

    def _share(self, believed: float, likelihood: float) -> Share:
        if self._belief.shape[2] == self._all_places:
            return Share(self._sight.nearest, believed, likelihood, NO_BORDERS)
        borders = np.zeros_like(self._outside)
        if self.begun:
            borders[0] = self._belief[0, :, -REACH:]
            borders[1] = self._belief[1, :, :REACH]
        return Share(self._sight.nearest, believed, likelihood, borders)

    @property
    def belief(self) -> Array:
        """Probability of each place, (K,); what is missing to 1 is that of being nowhere on it."""
        return np.asarray(self._of_place * self._unit / self._total, np.float32)

    @property
    def behind(self) -> Array:
        """Probability of each of the two places before the shard, (2,); 0 where there are none."""
        return np.asarray(self._outside[0].sum(axis=0))

    def believed(self, least: float) -> tuple[int, NDArray[np.int32], Array]:
        """Return the index of the best place among all of at least this probability, these, theirs.

        Places count from the shard's first and ascend, and the best is among them in any case.
        """
        places, beliefs = np.empty(len(self._of_place), np.int32), np.empty_like(self._of_place)
        scale = self._unit / self._total
        count, best = believed(self._of_place, scale, least, places, beliefs)
        return best, places[:count].copy(), beliefs[:count].copy()


def evenly_spaced(rows: Rows) -> Rows:
    """Return at most ``_SAMPLE`` of the rows, evenly spaced, to stand for all of them."""
    return cast(Rows, rows[:: -(-len(rows) // _SAMPLE)])


def _see(frame: Comparison, novelty: float) -> _Sight:
    """The nearer a place is, the likelier it is what is seen."""
    exponents = np.empty(len(frame.distances), np.float32)
    if frame.deviation == 0:
        return _Sight(0, 0.0, np.ones_like(exponents), 1.0)
    sharpness = novelty / frame.deviation
    nearest = exponents_of(frame.distances, sharpness, exponents)
    likelihood = np.exp(exponents, out=exponents)
    return _Sight(nearest, sharpness, likelihood, math.exp(novelty * _LOST_EVIDENCE))


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
