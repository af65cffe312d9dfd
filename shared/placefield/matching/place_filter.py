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
    COUNT_OF,
    COUNTS,
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

_NOVEL = 0.25  # a frame that is newer than this counts in full

Vector = NDArray[np.float64]


class Observation(NamedTuple):
    """What a frame shows.

    Attributes:
        step: how far it is from the frame before, or ``UNKNOWN``.
        novelty: how much it tells that the frame before has not told, 0 to 1.
        nearest: twice the squared distance of the nearest place of the shard, in squared units.
        inverse_temperature: by how much the log likelihood falls with the squared distance.
        log_likelihood: (K,) float32, at each place of the shard, less that at the nearest.
        lost_evidence: nats by which it is likelier, when lost, than at an average place.
    """

    step: float
    novelty: float
    nearest: int
    inverse_temperature: float
    log_likelihood: Array
    lost_evidence: float


class Trace(NamedTuple):
    """What the smoother needs of a frame: n places that were believed in, and the transition.

    Attributes:
        places: (n,) int32, ascending.
        belief: (n, 2, S) float32, posterior on the map and on its reverse.
        lost: (S,) float64, posterior of being lost, at each speed.
        evidence: (n,) float32, nats by which the frame is likelier at each place than when lost.
        counts: (S,) float32, how much of that counts at each speed.
        prior: (S,) float32, of the speeds in the transition to this frame.
        step: length of the step to it, or ``UNKNOWN``.
        stray: (S,) float64, likelihood of that step for a lost vehicle.
        jump: likewise for one that jumps.
        observed: whether the frame showed anything.
    """

    places: NDArray[np.int32]
    belief: Array
    lost: Vector
    evidence: Array
    counts: Array
    prior: Array
    step: float
    stray: Vector
    jump: float
    observed: bool


class Share(NamedTuple):
    """A shard's partial result for a frame.

    Its beliefs and evidence are against what the shard takes for the log likelihood when lost.

    Attributes:
        nearest: see ``Observation``.
        lost_log_likelihood: of the frame when lost, by these places, less that at the nearest.
        likelihood: sum of the places' likelihoods, in terms of that at the nearest.
        predicted: sum of the beliefs on the map before the update, a probability.
        expected: sum of these times the places' likelihoods.
        of_speed: (2, S) float64, sums of the beliefs at each speed, on the map and its reverse.
        halo: (2, S, REACH) float32, beliefs of the last places on the map and of the first on its
            reverse, from where the vehicle may leave the shard.
        places: (n,) int32, of the map, that may be in the frame's trace.
        evidence: (n,) float32, see ``Trace``.
        belief: (n, 2, S) float32, in them.
    """

    nearest: int
    lost_log_likelihood: float
    likelihood: float
    predicted: float
    expected: float
    of_speed: Vector
    halo: Array
    places: NDArray[np.int32]
    evidence: Array
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
        self._unlearned = self._motion.prior.astype(np.float64)
        self.drive = Drive(self._unlearned)
        """What has been learned along the drive."""
        self._lengths, self._own = lengths, own
        self._apart = np.ascontiguousarray(lengths.apart[:, own])
        self._all_places = lengths.apart.shape[1]
        # Beliefs are (hypotheses, speeds, places), and kept as they come, together with their sum.
        self._belief = np.empty((2, len(SPEEDS), own.stop - own.start), np.float32)
        self._halo = np.empty((2, len(SPEEDS), REACH), np.float32)
        self.begun = False
        """Whether a frame was observed."""
        self.forget()

    def forget(self) -> None:
        """Begin anew: the vehicle may be anywhere. What was learned along the drive stays."""
        self._belief[:] = self._anywhere(0.5 * self._unlearned)[:, :, None]
        self._of_place = self._belief.sum(axis=1)
        self._halo[:] = 0
        self._lost, self._total = 0.5 * self._unlearned, 1.0
        self._on_map = 0.5 * float(HYPOTHESES[0])
        self.begun = False

    def _anywhere(self, of_speed: Vector) -> Array:
        """Probability of each place, (2, S), of a vehicle that may be anywhere."""
        return np.asarray(HYPOTHESES[:, None] * of_speed / self._all_places, np.float32)

    def local(self, observation: Observation) -> Share:
        """Predict, and update by what the shard's places have of the frame."""
        self._observation = observation
        self._counts = np.minimum(COUNTS, observation.novelty / _NOVEL)
        likelihood = np.exp(observation.log_likelihood)
        summed = sum_of(likelihood)
        lost = math.log(summed / len(likelihood)) + observation.lost_evidence
        evidence = observation.log_likelihood - np.float32(lost)
        seen = np.exp(self._counts.astype(np.float32)[:, None] * evidence)
        of_speed = np.empty((2, len(SPEEDS)))
        predicted, expected = self._advance(seen, likelihood, of_speed)
        places = self._most_believed(float(of_speed.sum()))
        return Share(
            observation.nearest,
            lost,
            summed,
            predicted,
            expected,
            of_speed,
            self._border(),
            places + np.int32(self._own.start),
            evidence[places],
            np.ascontiguousarray(self._belief[:, :, places].transpose(2, 0, 1)),
        )

    def _advance(self, seen: Array, likelihood: Array, of_speed: Vector) -> tuple[float, float]:
        """Predict and update the beliefs; return the sums before the update that a share has."""
        if not self.begun:
            self.begun = True
            self._prior, self._jump = self._motion.prior, 1.0
            self._stray = np.ones(len(SPEEDS))
            self._belief *= seen[COUNT_OF]
            self._of_place = self._belief.sum(axis=1)
            of_speed[:] = self._belief.sum(axis=2, dtype=np.float64)
            return 0.0, 0.0
        self._prior = self.drive.prior.astype(np.float32)
        step = self._observation.step
        self._stray, self._jump = self._step_likelihood_when_lost(step)
        adrift = self._adrift(self._lost / self._total)
        transition = Transition(
            self._motion,
            self._prior,
            (1 - LOSE) / self._total,
            self._anywhere(FIND * adrift),
            step,
            self._lengths.standing,
        )
        halo = np.float32(1 - LOSE) * self._halo
        self._lost = (1 - FIND) * adrift + LOSE * self._jump * (
            1 - float(self._lost.sum()) / self._total
        ) * self._unlearned
        return advance(
            self._belief, halo, transition, self._apart, seen, likelihood, self._of_place, of_speed
        )

    def _adrift(self, lost: Vector) -> Vector:
        """Predict the speed, (S,), of a vehicle that was lost, and weigh it by the observed step.

        It keeps its speed for a while, as one on the map does.
        """
        change = self._motion.change
        kept = (1 - change) * lost + self._unlearned * float(change @ lost)
        return np.asarray(kept * self._stray)

    def _step_likelihood_when_lost(self, step: float) -> tuple[Vector, float]:
        """Of a vehicle that stays lost, at each speed, and of one that jumps."""
        if step < 0:
            return np.ones(len(SPEEDS)), 1.0
        some = np.empty((len(SPEEDS), self._lengths.some.shape[1]), np.float32)
        step_likelihoods(self._lengths.some, self._lengths.standing, SPEEDS, step, some)
        return some.mean(axis=1, dtype=np.float64), mean_student(self._lengths.jumps, step)

    def _most_believed(self, total: float) -> NDArray[np.int32]:
        """Return at least those places of the shard that will be of some belief among all."""
        both = self._of_place[0] + self._of_place[1]
        places = np.empty(len(both), np.int32)
        least = min(NEGLIGIBLE * total, float(both.max()))
        return most(both, places[: pick(both, least, places)])

    def _border(self) -> Array:
        halo = np.zeros_like(self._halo)
        edge = min(REACH, self._belief.shape[2])
        halo[0, :, REACH - edge :] = self._belief[0, :, -edge:]
        halo[1, :, :edge] = self._belief[1, :, :edge]
        return halo

    def reduce(self, shares: Sequence[Share], number: int) -> Trace:
        """Bring the beliefs to what they are among all shards, and return the frame's trace.

        Args:
            shares: of all shards, in the order of their places.
            number: which of them this one's is.
        """
        seen = self._observation
        nearest = min(share.nearest for share in shares)
        # Nats by which a frame is less likely at the shard's nearest place than at that of all.
        behind = [0.5 * (share.nearest - nearest) * seen.inverse_temperature for share in shares]
        both = list(zip(behind, shares, strict=True))
        mean = sum(math.exp(-less) * share.likelihood for less, share in both) / self._all_places
        lost = math.log(mean) + seen.lost_evidence
        # Nats by which the shard's evidence against being lost is too little.
        wrong = [share.lost_log_likelihood - less - lost for less, share in both]
        factors = [np.exp(self._counts * nats)[COUNT_OF] for nats in wrong]
        of_speed = np.sum(
            [factor * share.of_speed for factor, share in zip(factors, shares, strict=True)], axis=0
        )
        self._total = float(of_speed.sum() + self._lost.sum())
        self._correct(factors[number])
        self.too_fast = float(of_speed[:, -1].sum() + self._lost[-1]) / self._total
        predicted = sum(share.predicted for share in shares)
        if predicted > 0 and seen.novelty > 0:
            expected = sum(math.exp(-less) * share.expected for less, share in both)
            speeds = of_speed[0] / self._total
            self.drive.learn(speeds, self._on_map, expected / predicted / mean, seen.novelty)
        self._on_map = float(of_speed[0].sum()) / self._total
        for hypothesis, neighbour in enumerate((number - 1, number + 1)):
            if 0 <= neighbour < len(shares):
                factor = (factors[neighbour] / self._total)[:, None]
                self._halo[hypothesis] = shares[neighbour].halo[hypothesis] * factor
        return self._trace(list(zip(wrong, factors, shares, strict=True)))

    def _correct(self, factor: Vector) -> None:
        if np.any(factor != 1):  # there are other shards
            self._belief *= factor.astype(np.float32)[:, None]
            self._of_place = self._belief.sum(axis=1)

    def _trace(self, shares: list[tuple[float, Vector, Share]]) -> Trace:
        belief = np.concatenate(
            [share.belief * (factor / self._total) for _, factor, share in shares]
        )
        evidence = np.concatenate([share.evidence + nats for nats, _, share in shares])
        places = np.concatenate([share.places for _, _, share in shares])
        believed = belief.sum(axis=(1, 2))
        kept = np.flatnonzero(believed >= min(NEGLIGIBLE, believed.max())).astype(np.int32)
        kept = most(believed, kept)
        return Trace(
            places[kept],
            belief[kept].astype(np.float32),
            self._lost / self._total,
            evidence[kept].astype(np.float32),
            self._counts[COUNT_OF].astype(np.float32),
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
        return np.asarray(np.maximum(resolved, 0) / np.float32(self._total))

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
