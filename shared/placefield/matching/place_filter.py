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
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.belief_kernels import (
    beliefs_at,
    drift,
    find_and_lose,
    normalise,
    pick,
    resolve,
    step_likelihood_when_lost,
)
from placefield.matching.drive import Drive
from placefield.matching.filter_kernels import Transition, advance
from placefield.matching.motion import (
    AGAIN,
    HYPOTHESES,
    LOSE,
    REACH,
    RESOLVED,
    SPEEDS,
    Array,
    StepLengths,
    motion,
    step_likelihood,
)
from placefield.matching.odometry import Road, Way, carry, speeds_of
from placefield.matching.partial_results import Share
from placefield.matching.trace import NEGLIGIBLE, Trace, Transit, most
from placefield.matching.way_kernel import spread

_NOVEL = 0.25  # a frame that is newer than this counts in full

Vector = NDArray[np.float64]


class Observation(NamedTuple):
    """What a frame shows.

    Attributes:
        step: how far it is from the frame before, or ``UNKNOWN``.
        way: driven since that, None if odometry does not tell.
        novelty: how much it tells that the frame before has not told, 0 to 1.
        evidence: (K,) float32, nats by which it is likelier at each place of the shard than when
            lost.
        lost_evidence: nats by which it is likelier, when lost, than at an average place.
    """

    step: float
    way: Way | None
    novelty: float
    evidence: Array
    lost_evidence: float


class PlaceFilter:
    """The posterior of every place of a shard, given the frames so far."""

    def __init__(self, lengths: StepLengths, own: slice, road: Road | None = None) -> None:
        """Prepare for a new stream.

        Args:
            lengths: of steps on the whole map.
            own: the shard's places in the map.
            road: the way along the whole map; None if its metres are not known.
        """
        self._motion = motion()
        self._unlearned = self._motion.prior.astype(np.float64)
        self.drive = Drive(self._unlearned)
        """What has been learned along the drive."""
        self._lengths, self._own, self._road = lengths, own, road
        self._believed: Trace | None = None
        self._apart = np.ascontiguousarray(lengths.apart[:, own])
        self._all_places = lengths.apart.shape[1]
        # Beliefs are (hypotheses, speeds, places), and kept as they come, together with their sum.
        self._belief = np.empty((2, len(SPEEDS), own.stop - own.start), np.float32)
        self._halo = np.empty((2, len(SPEEDS), REACH), np.float32)
        self.begun = False
        """Whether a frame was observed."""
        self.too_fast = 0.0
        """Posterior that the vehicle moves faster than the map resolves."""
        self.forget()

    def forget(self) -> None:
        """Begin anew: the vehicle may be anywhere. What was learned along the drive stays."""
        self._belief[:] = self._anywhere(0.5 * self._unlearned)[:, :, None]
        self._of_place = self._belief.sum(axis=1)
        self._halo[:] = 0
        self._lost, self._total = 0.5 * self._unlearned, 1.0
        self._on_map = 0.5 * float(HYPOTHESES[0])
        self._believed = None
        self.begun = False

    def _anywhere(self, of_speed: Vector) -> Array:
        """Probability of each place, (2, S), of a vehicle that may be anywhere."""
        return np.asarray(HYPOTHESES[:, None] * of_speed / self._all_places, np.float32)

    def local(self, observation: Observation) -> Share:
        """Predict, and update by what the shard's places have of the frame."""
        self._observation = observation
        counts = (min(count, observation.novelty / _NOVEL) for count in (AGAIN, 1))
        self._counts = np.fromiter(counts, np.float32, 2)
        observed = np.exp(self._counts[:, None] * observation.evidence)
        likelihood = observed[1] if self._counts[1] == 1 else np.exp(observation.evidence)
        of_speed = np.empty((2, len(SPEEDS)))
        if not self.begun:
            predicted, expected = self._begin(observed, of_speed)
        elif self._road is not None and observation.way is not None:
            predicted, expected = self._advance_by(
                self._road, observation.way, observed, likelihood, of_speed
            )
        else:
            predicted, expected = self._advance(observed, likelihood, of_speed)
        places = self._most_believed(float(of_speed.sum()))
        return Share(
            predicted,
            expected,
            of_speed,
            self._border(),
            places + np.int32(self._own.start),
            observation.evidence[places],
            beliefs_at(self._belief, places),
        )

    def _begin(self, observed: Array, of_speed: Vector) -> tuple[float, float]:
        """Update beliefs that none has moved yet."""
        self.begun = True
        self._prior, self._jump = self._motion.prior, 1.0
        self._stray = np.ones(len(SPEEDS))
        self._belief *= observed[1]
        self._of_place = self._belief.sum(axis=1)
        of_speed[:] = self._belief.sum(axis=2, dtype=np.float64)
        return 0.0, 0.0

    def _advance(self, observed: Array, likelihood: Array, of_speed: Vector) -> tuple[float, float]:
        """Predict and update the beliefs; return the sums before the update that a share has."""
        self._prior = self.drive.prior.astype(np.float32)
        lengths, step = self._lengths, self._observation.step
        self._stray, self._jump = step_likelihood_when_lost(lengths, SPEEDS, step)
        lost = self._lost / self._total
        adrift = drift(lost, self._motion.change, self._unlearned, self._stray)
        jumped = self._jump * (1 - float(lost.sum())) * self._unlearned
        found, self._lost = find_and_lose(adrift, jumped, self._all_places)
        kept = (1 - LOSE) / self._total
        transition = Transition(self._motion, self._prior, kept, found, step, lengths.standing)
        halo = np.float32(1 - LOSE) * self._halo
        return advance(
            self._belief,
            halo,
            transition,
            self._apart,
            observed,
            likelihood,
            self._of_place,
            of_speed,
        )

    def _advance_by(
        self, road: Road, way: Way, observed: Array, likelihood: Array, of_speed: Vector
    ) -> tuple[float, float]:
        """Predict by odometry: it tells the speed of every vehicle, on the map and lost."""
        self._prior = self.drive.prior.astype(np.float32)
        speeds, carried = speeds_of(way.pace / road.spacing), self._carried(road, way)
        steps, self._stray, self._jump = self._likelihoods_of_way(way, road)
        lost = float(self._lost.sum()) / self._total
        adrift, jumped = self._stray * lost * speeds, self._jump * (1 - lost) * speeds
        found, self._lost = find_and_lose(adrift, jumped, self._all_places)
        driven = speeds.astype(np.float32)
        return spread(
            self._belief,
            carried,
            steps,
            driven,
            found,
            observed,
            likelihood,
            self._of_place,
            of_speed,
        )

    def _carried(self, road: Road, way: Way) -> Array:
        """Carry the beliefs of all shards on by a way, see ``carry``, to the own places."""
        of_place = self._of_place * np.float32((1 - LOSE) / self._total)
        carried = np.zeros((2, *of_place.shape), np.float32)
        least = NEGLIGIBLE / self._all_places
        picked = np.empty(of_place.shape[1], np.int32)
        own = picked[: pick(of_place[0] + of_place[1], least, picked)]
        first = self._own.start
        carry(own + np.int32(first), of_place.T[own].copy(), road, way, first, carried)
        if self._believed is not None:
            places = self._believed.places
            others = (places < first) | (places >= self._own.stop)
            belief = (1 - LOSE) * self._believed.belief[others].sum(axis=2)
            carry(places[others], belief.astype(np.float32), road, way, first, carried)
        return np.asarray(carried)

    def _likelihoods_of_way(self, way: Way, road: Road) -> tuple[Array, Vector, float]:
        """Of the observed step: by the place it leads to, (K,), when lost, (1,), and of a jump."""
        lengths, pace, step = self._lengths, way.pace / road.spacing, self._observation.step
        steps = np.empty(self._apart.shape[1], np.float32)
        step_likelihood(self._apart, 0, lengths.standing, pace, step, steps)
        return steps, *step_likelihood_when_lost(lengths, np.array([pace]), step)

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
        observed = self._observation
        of_speed = reduce(np.add, [share.of_speed for share in shares])
        self._total = float(of_speed.sum() + self._lost.sum())
        too_fast = of_speed[:, RESOLVED:].sum() + self._lost[RESOLVED:].sum()
        self.too_fast = min(float(too_fast) / self._total, 1.0)
        predicted = sum(share.predicted for share in shares)
        if predicted > 0 and observed.novelty > 0:
            expected = sum(share.expected for share in shares) * math.exp(observed.lost_evidence)
            speeds = of_speed[0] / self._total
            self.drive.learn(speeds, self._on_map, expected / predicted, observed.novelty)
        self._on_map = float(of_speed[0].sum()) / self._total
        for hypothesis, neighbour in enumerate((number - 1, number + 1)):
            if 0 <= neighbour < len(shares):
                halo = shares[neighbour].halo[hypothesis]
                self._halo[hypothesis] = halo / np.float32(self._total)
        self._believed = self._trace(shares)
        return self._believed

    def _trace(self, shares: Sequence[Share]) -> Trace:
        belief = np.concatenate([share.belief for share in shares])
        evidence = np.concatenate([share.evidence for share in shares])
        places = np.concatenate([share.places for share in shares])
        believed = normalise(belief, self._total)
        picked = np.empty(len(believed), np.int32)
        least = min(NEGLIGIBLE, float(believed.max()))
        kept = most(believed, picked[: pick(believed, least, picked)])
        transit = Transit(
            places[kept],
            np.exp(self._counts[:, None] * evidence[kept]),
            self._prior,
            self._observation.step,
            self._stray,
            self._jump,
        )
        observed = self._observation.novelty > 0
        lost = self._lost / self._total
        return Trace(transit, belief[kept], lost, self._observation.way, observed)

    def posterior(self) -> tuple[Array, int]:
        """Return the posterior of each place, (K,), at a speed that the map resolves, and the best.

        What is missing to 1 is the posterior of being on none of them, or faster.
        """
        posterior = np.empty(self._belief.shape[2], np.float32)
        too_fast = self._belief[0, RESOLVED:]
        return posterior, resolve(self._of_place[0], too_fast, self._total, posterior)

    @property
    def behind(self) -> Array:
        """Posterior of each of the places before the shard, (REACH,); 0 where there are none."""
        return np.asarray(self._halo[0].sum(axis=0))
