"""The rule ``filter``: a Bayes filter over place and speed, which copes with any speed.

The vehicle is at a place and moves at a speed (``placefield.matching.motion``), or it is lost: on
no place of the map, or on one that it has jumped to. Two things are observed. How far a frame is
from every place, in descriptor space, tells the place. How far it is from the frame before, against
how far the places are from each other, tells the speed; since both frames of that pair are of one
traverse, light and season are out of it. Frames of another route resemble some place or other, and
those after them its neighbours: by chance they follow the map for a while. So the map competes with
a null hypothesis, the same places in reverse order, which chance follows as well.

``placefield.matching.textbook`` has the same filter without shards or compiled loops.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import sum_of
from placefield.matching.drive import Drive
from placefield.matching.filter_kernels import Transition, advance, pick
from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    REACH,
    SPEEDS,
    Array,
    StepLengths,
    mean_student,
    motion,
    step_likelihoods,
)

NEGLIGIBLE = 1e-6
"""A belief below this is left out: no sum of a few of them changes a match."""

MOST_PLACES = 512
"""Places of most belief that the smoother knows of a frame."""


class Observation(NamedTuple):
    """What a frame shows.

    Attributes:
        step: how far it is from the frame before, or ``UNKNOWN``.
        novelty: how much it tells that the frame before has not told, 0 to 1.
        nearest: twice the squared distance of the nearest place of the shard, in squared units.
        inverse_temperature: by how much the log likelihood falls with the squared distance.
        likelihood: (K,) float32, at each place of the shard, in terms of that at the nearest.
        lost_evidence: nats by which it is likelier, when lost, than at an average place.
    """

    step: float
    novelty: float
    nearest: int
    inverse_temperature: float
    likelihood: Array
    lost_evidence: float


class Trace(NamedTuple):
    """What the smoother needs of a frame: n places that were believed in, and the transition.

    Attributes:
        places: (n,) int32, ascending.
        belief: (n, 2, S) float32, posterior on the map and on its reverse.
        lost: posterior of being lost.
        likelihood: (n,) float32, of the observation, in terms of that at the nearest place.
        lost_likelihood: likewise, when lost.
        prior: (S,) float32, of the speeds in the transition to this frame.
        step: length of the step to it, or ``UNKNOWN``.
        stray: likelihood of that step for a lost vehicle.
        jump: likewise for one that jumps.
        observed: whether the frame showed anything.
    """

    places: NDArray[np.int32]
    belief: Array
    lost: float
    likelihood: Array
    lost_likelihood: float
    prior: Array
    step: float
    stray: float
    jump: float
    observed: bool


class Share(NamedTuple):
    """A shard's partial result for a frame, in a unit of the shard's own.

    Attributes:
        nearest: see ``Observation``.
        predicted: sum of the beliefs on the map before the update, a probability.
        likelihood: sum of the places' likelihoods.
        of_null: sum of the beliefs on the reversed map.
        of_speed: (S,) float64, sum of those on the map at each speed.
        halo: (2, S, REACH) float32, beliefs of the last places on the map and of the first on its
            reverse, from where the vehicle may leave the shard.
        places: (n,) int32, of the map, that may be in the frame's trace.
        place_likelihood: (n,) float32.
        belief: (n, 2, S) float32, in them.
    """

    nearest: int
    predicted: float
    likelihood: float
    of_null: float
    of_speed: NDArray[np.float64]
    halo: Array
    places: NDArray[np.int32]
    place_likelihood: Array
    belief: Array


class PlaceFilter:
    """The posterior of every place of a shard, given the frames so far."""

    def __init__(self, lengths: StepLengths, own: slice) -> None:
        """Prepare for a new stream.

        Args:
            lengths: of steps on the whole map.
            own: the shard's places in the map.
        """
        self._motion = motion()
        self.drive = Drive(self._motion.prior.astype(np.float64))
        """What has been learned along the drive."""
        self._lengths, self._own = lengths, own
        self._apart = np.ascontiguousarray(lengths.apart[:, own])
        self._all_places = lengths.apart.shape[1]
        # Beliefs are (hypotheses, speeds, places), and kept as they come, which is together with
        # the sum of all, and in a unit, since likelihoods here are in terms of that at the nearest
        # place here, which may not be the nearest of all.
        self._belief = np.empty((2, len(SPEEDS), own.stop - own.start), np.float32)
        self._halo = np.empty((2, len(SPEEDS), REACH), np.float32)
        self.begun = False
        """Whether a frame was observed."""
        self.forget()

    def forget(self) -> None:
        """Begin anew: the vehicle may be anywhere. What was learned along the drive stays."""
        self._belief[:] = (self._anywhere(self._motion.prior) / 2)[:, :, None]
        self._of_place = self._belief.sum(axis=1)
        self._halo[:] = 0
        self._unit, self._lost, self._total = 1.0, 0.5, 1.0
        self._on_map = float(HYPOTHESES[0]) / 2
        self.begun = False

    def _anywhere(self, prior: Array) -> Array:
        """Probability of each place, (2, S), of a vehicle on the map that may be anywhere."""
        return np.asarray(HYPOTHESES[:, None] * prior / self._all_places, np.float32)

    def local(self, observation: Observation) -> Share:
        """Predict, and update by what the shard's places have of the frame."""
        self._observation = observation
        predicted, of_speed = self._advance() if self.begun else self._begin()
        likelihood = observation.likelihood
        of_null = sum_of(self._of_place[1])
        places = np.empty(len(likelihood), np.int32)
        both = self._of_place[0] + self._of_place[1]
        # At least those that will be of some belief among all shards.
        least = min(NEGLIGIBLE * (float(of_speed.sum()) + of_null), float(both.max()))
        places = most(both, places[: pick(both, least, places)])
        halo = np.zeros_like(self._halo)
        edge = min(REACH, len(likelihood))
        halo[0, :, REACH - edge :] = self._belief[0, :, -edge:]
        halo[1, :, :edge] = self._belief[1, :, :edge]
        return Share(
            observation.nearest,
            predicted,
            sum_of(likelihood),
            of_null,
            of_speed,
            halo,
            places + np.int32(self._own.start),
            likelihood[places],
            np.ascontiguousarray(self._belief[:, :, places].transpose(2, 0, 1)),
        )

    def _begin(self) -> tuple[float, NDArray[np.float64]]:
        self.begun = True
        self._prior, self._stray, self._jump = self._motion.prior, 1.0, 1.0
        self._belief *= self._observation.likelihood
        self._of_place = self._belief.sum(axis=1)
        return 0.0, self._belief[0].sum(axis=1, dtype=np.float64)

    def _advance(self) -> tuple[float, NDArray[np.float64]]:
        self._prior = self.drive.prior.astype(np.float32)
        self._stray, self._jump = self._step_likelihood_when_lost(self._observation.step)
        was_lost = self._lost / self._total
        transition = Transition(
            self._motion,
            self._prior,
            (1 - LOSE) * self._unit / self._total,
            np.asarray(FIND * self._stray * was_lost * self._anywhere(self._prior), np.float32),
            self._observation.step,
            self._lengths.standing,
        )
        of_speed = np.empty(len(SPEEDS))
        predicted = advance(
            self._belief,
            np.float32(1 - LOSE) * self._halo,
            transition,
            self._apart,
            self._observation.likelihood,
            self._of_place,
            of_speed,
        )
        self._lost = (1 - FIND) * self._stray * was_lost + LOSE * self._jump * (1 - was_lost)
        return predicted, of_speed

    def _step_likelihood_when_lost(self, step: float) -> tuple[float, float]:
        """Of a vehicle that stays lost, at any speed, and of one that jumps."""
        if step < 0:
            return 1.0, 1.0
        some = np.empty((len(SPEEDS), self._lengths.some.shape[1]), np.float32)
        step_likelihoods(self._lengths.some, self._lengths.standing, SPEEDS, step, some)
        means = some.mean(axis=1, dtype=np.float64)
        return float(self._motion.prior @ means), mean_student(self._lengths.jumps, step)

    def reduce(self, shares: Sequence[Share], number: int) -> Trace:
        """Bring the beliefs to what they are among all shards, and return the frame's trace.

        Args:
            shares: of all shards, in the order of their places.
            number: which of them this one's is.
        """
        seen = self._observation
        nearest = min(share.nearest for share in shares)
        units = [
            math.exp(0.5 * (nearest - share.nearest) * seen.inverse_temperature) for share in shares
        ]
        both = list(zip(units, shares, strict=True))
        of_speed = np.sum([unit * share.of_speed for unit, share in both], axis=0)
        of_null = sum(unit * share.of_null for unit, share in both)
        mean = sum(unit * share.likelihood for unit, share in both) / self._all_places
        predicted = sum(share.predicted for share in shares)
        lost_likelihood = math.exp(seen.lost_evidence) * mean
        self._lost *= lost_likelihood
        updated = float(of_speed.sum())
        self._total = updated + of_null + self._lost
        self._unit = units[number]
        if predicted > 0 and seen.novelty > 0:
            self.drive.learn(
                of_speed / self._total, self._on_map, updated / predicted / mean, seen.novelty
            )
        self._on_map = updated / self._total
        for hypothesis, neighbour in enumerate((number - 1, number + 1)):
            if 0 <= neighbour < len(shares):
                halo = shares[neighbour].halo[hypothesis]
                self._halo[hypothesis] = halo * (units[neighbour] / self._total)
        return self._trace(both, lost_likelihood)

    def _trace(self, shares: list[tuple[float, Share]], lost_likelihood: float) -> Trace:
        belief = np.concatenate([share.belief * (unit / self._total) for unit, share in shares])
        likelihood = np.concatenate([unit * share.place_likelihood for unit, share in shares])
        places = np.concatenate([share.places for _, share in shares])
        believed = belief.sum(axis=(1, 2))
        kept = np.flatnonzero(believed >= min(NEGLIGIBLE, believed.max())).astype(np.int32)
        kept = most(believed, kept)
        return Trace(
            places[kept],
            belief[kept].astype(np.float32),
            self._lost / self._total,
            likelihood[kept].astype(np.float32),
            lost_likelihood,
            self._prior,
            self._observation.step,
            self._stray,
            self._jump,
            self._observation.novelty > 0,
        )

    @property
    def belief(self) -> Array:
        """Posterior of each place, (K,), at a speed that the map resolves.

        What is missing to 1 is the posterior of being on none of them, or faster.
        """
        resolved = self._of_place[0] - self._belief[0, -1]
        return np.asarray(np.maximum(resolved, 0) * (self._unit / self._total), np.float32)

    @property
    def too_fast(self) -> float:
        """Posterior, 0 to 1, that the vehicle moves on the map faster than that resolves."""
        unresolved = float(self._belief[0, -1].sum(dtype=np.float64))
        return min(unresolved * self._unit / self._total, 1.0)

    @property
    def behind(self) -> Array:
        """Posterior of each of the places before the shard, (REACH,); 0 where there are none."""
        return np.asarray(self._halo[0].sum(axis=0))


def most(belief: Array, places: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return those of these places that are among the ``MOST_PLACES`` of most belief, ascending."""
    if len(places) <= MOST_PLACES:
        return places
    first = np.argsort(-belief[places], kind="stable")[:MOST_PLACES]
    return np.sort(places[first])
