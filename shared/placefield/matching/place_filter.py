"""The rule ``filter``: a Bayes filter over place and speed, for a vehicle at any speed.

The vehicle is at a place of the map and moves at a speed (``placefield.matching.motion``), or it is
lost: it is at no place of the map, or it has jumped to an unknown one. The filter observes two
things. The distance of a frame from every place, in descriptor space, is evidence of the place. The
distance of a frame from the frame before, compared with the distances between places, is evidence
of the speed. Both frames of that pair come from one traverse, so light and season do not matter.
Frames of another route resemble some place by chance, and the frames after them resemble its
neighbours, so for a while they seem to follow the map. Therefore the map competes with a null
hypothesis: the same places in reverse order, which chance follows as often.

``placefield.matching.textbook`` has the same filter without shards or compiled loops.
"""

import math
from collections.abc import Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from placefield.matching.belief_kernels import (
    at_ends,
    at_likeliest,
    find_and_lose,
    normalise,
    predict_lost,
    resolve,
    step_likelihood_when_lost,
    sums_of,
)
from placefield.matching.carrying import carried_to
from placefield.matching.drive_statistics import DriveStatistics
from placefield.matching.filter_kernels import Transition, advance
from placefield.matching.motion import (
    AGAIN,
    HYPOTHESES,
    LOSE,
    REACH,
    SPEEDS,
    Array,
    StepLengths,
    motion,
    step_likelihood,
)
from placefield.matching.observation import Observation
from placefield.matching.odometry import Displacement, speeds_of
from placefield.matching.odometry_kernel import OdometryTransition, spread
from placefield.matching.partial_results import FilterPartial
from placefield.matching.pieces import Pieces
from placefield.matching.roads import LINE, Roads, RouteCells
from placefield.matching.trace import ObservedTransition, Trace

_NOVEL = 0.25  # the evidence of a frame of at least this novelty counts in full

Vector = NDArray[np.float64]


class PlaceFilter:
    """The posterior of every place of a shard, given the frames so far."""

    def __init__(self, lengths: StepLengths, own: slice, roads: Roads = LINE) -> None:
        """Prepare for a new stream.

        Args:
            lengths: of steps on the whole map.
            own: the shard's places in the map.
            roads: of the whole map.
        """
        self._motion = motion()
        self._unlearned = self._motion.prior.astype(np.float64)
        self.statistics = DriveStatistics(self._unlearned)
        """Statistics of the drive so far."""
        self._lengths, self._own, self._roads = lengths, own, roads
        self._last_trace: Trace | None = None
        self._apart = np.ascontiguousarray(lengths.apart[:, own])
        self._all_places = lengths.apart.shape[1]
        self._pieces = Pieces(roads.chains, own, self._all_places)
        # Beliefs are (hypotheses, speeds, places), not normalised: ``_total`` is their sum.
        self._belief = np.empty((2, len(SPEEDS), own.stop - own.start), np.float32)
        self._halo = np.empty((2, len(SPEEDS), REACH), np.float32)
        self.begun = False
        """Whether a frame was observed."""
        self.too_fast = 0.0
        """Posterior that the vehicle moves faster than the map resolves."""
        self.forget()

    def forget(self) -> None:
        """Reset the beliefs: the vehicle may be anywhere. The statistics of the drive stay."""
        self._belief[:] = self._anywhere(0.5 * self._unlearned)[:, :, None]
        self._by_place = self._belief.sum(axis=1)
        self._halo[:] = 0
        self._lost, self._total = 0.5 * self._unlearned, 1.0
        self._on_map = 0.5 * float(HYPOTHESES[0])
        self._last_trace = None
        self.begun = False

    def grow(self, lengths: StepLengths) -> None:
        """Append places to the map, a line, which a filter of the whole map has to itself.

        No belief is in the new places yet; the vehicle may be found there from the next frame on.

        Args:
            lengths: of steps on the map with the new places, which are its last ones.
        """
        added = lengths.apart.shape[1] - self._all_places
        self._belief = np.pad(self._belief, ((0, 0), (0, 0), (0, added)))
        self._by_place = np.pad(self._by_place, ((0, 0), (0, added)))
        self._lengths, self._apart = lengths, np.ascontiguousarray(lengths.apart)
        self._all_places += added
        self._own = slice(0, self._all_places)
        self._pieces = Pieces(self._roads.chains, self._own, self._all_places)

    def _anywhere(self, by_speed: Vector) -> Array:
        """Return the probability of each place, (2, S), of a vehicle that may be anywhere."""
        return np.asarray(HYPOTHESES[:, None] * by_speed / self._all_places, np.float32)

    def local(self, observation: Observation) -> FilterPartial:
        """Predict the beliefs of the shard's places, and update them by the frame."""
        self._weigh(observation)
        ratios = np.exp(self._weights[:, None] * observation.evidence)
        full_ratio = ratios[1] if self._weights[1] == 1 else np.exp(observation.evidence)
        by_speed = np.empty((2, len(SPEEDS)))
        if not self.begun:
            predicted, expected = self._begin(ratios, by_speed)
        elif self._roads.cells is not None and observation.displacement is not None:
            predicted, expected = self._advance_by_odometry(
                self._roads.cells, observation.displacement, ratios, full_ratio, by_speed
            )
        else:
            predicted, expected = self._advance(ratios, full_ratio, by_speed)
        places, evidence, belief = at_likeliest(
            self._belief, self._by_place, by_speed, observation.evidence
        )
        halo, first = at_ends(self._belief, REACH), np.int32(self._own.start)
        return FilterPartial(predicted, expected, by_speed, halo, places + first, evidence, belief)

    def _weigh(self, observation: Observation) -> None:
        """Keep an observation, and how much of its evidence counts, see ``AGAIN``."""
        self._observation = observation
        weights = [min(weight, observation.novelty / _NOVEL) for weight in (AGAIN, 1)]
        self._weights = np.array(weights, np.float32)

    def _begin(self, ratios: Array, by_speed: Vector) -> tuple[float, float]:
        """Update the initial beliefs by the first frame, without a prediction."""
        self._predict_nothing()
        self._belief *= ratios[1]
        self._by_place = self._belief.sum(axis=1)
        by_speed[:] = self._belief.sum(axis=2, dtype=np.float64)
        return 0.0, 0.0

    def _predict_nothing(self) -> None:
        """Begin: no transition leads to the first frame."""
        self.begun = True
        self._prior, self._jump_likelihood = self._motion.prior, 1.0
        self._lost_likelihood = np.ones(len(SPEEDS))

    def _predict_lost(self) -> Transition:
        """Predict the beliefs of being lost, and return the transition to the frame."""
        self._prior = self.statistics.prior
        lengths, step = self._lengths, self._observation.step
        likelihoods = step_likelihood_when_lost(lengths, SPEEDS, step)
        self._lost_likelihood, self._jump_likelihood = likelihoods
        found, self._lost = predict_lost(
            self._lost / self._total,
            self._motion.change,
            self._unlearned,
            likelihoods,
            self._all_places,
        )
        kept = (1 - LOSE) / self._total
        return Transition(self._motion, self._prior, kept, found, step, lengths.stationary)

    def _advance(self, ratios: Array, full_ratio: Array, by_speed: Vector) -> tuple[float, float]:
        """Predict and update by the motion model; return ``predicted`` and ``expected``."""
        transition = self._predict_lost()
        halos = self._pieces.halos(self._halo, self._last_trace)
        return advance(
            self._belief,
            self._pieces.edges,
            halos,
            transition,
            self._apart,
            ratios,
            full_ratio,
            self._by_place,
            by_speed,
        )

    def _advance_by_odometry(
        self,
        cells: RouteCells,
        displacement: Displacement,
        ratios: Array,
        full_ratio: Array,
        by_speed: Vector,
    ) -> tuple[float, float]:
        """Predict by odometry, which gives the speed on the map and when lost, and update."""
        by_place = self._by_place * np.float32((1 - LOSE) / self._total)
        carried = carried_to(self._own, by_place, self._last_trace, self._roads, displacement)
        transition = self._predict_lost_by_odometry(displacement.pace / cells.spacing)
        return spread(
            self._belief,
            carried,
            self._step_likelihoods(self._apart, transition.pace),
            transition.speeds,
            transition.found,
            ratios,
            full_ratio,
            self._by_place,
            by_speed,
        )

    def _predict_lost_by_odometry(self, pace: float) -> OdometryTransition:
        """Predict the beliefs of being lost, at a pace in places per frame."""
        self._prior = self.statistics.prior
        speeds = speeds_of(pace)
        self._lost_likelihood, self._jump_likelihood = step_likelihood_when_lost(
            self._lengths, np.array([pace]), self._observation.step
        )
        lost = float(self._lost.sum()) / self._total
        still_lost = self._lost_likelihood * lost * speeds
        jumped = self._jump_likelihood * (1 - lost) * speeds
        found, self._lost = find_and_lose(still_lost, jumped, self._all_places)
        return OdometryTransition(pace, speeds.astype(np.float32), found)

    def _step_likelihoods(self, apart: Array, pace: float) -> Array:
        """Return the likelihood of the step at each of some places, (n,); see ``StepLengths``."""
        steps = np.empty(apart.shape[1], np.float32)
        stationary = self._lengths.stationary
        step_likelihood(apart, 0, stationary, pace, self._observation.step, steps)
        return steps

    def reduce(self, partials: Sequence[FilterPartial], number: int) -> Trace:
        """Normalise the beliefs over all shards, and return the frame's trace.

        Args:
            partials: of all shards, in the order of their places.
            number: index of this shard among them.
        """
        observed = self._observation
        by_speed = reduce(np.add, [partial.by_speed for partial in partials])
        self._total, on_map, too_fast = sums_of(by_speed, self._lost)
        self.too_fast = min(too_fast / self._total, 1.0)
        predicted = sum(partial.predicted for partial in partials)
        if predicted > 0 and observed.novelty > 0:
            expected = sum(partial.expected for partial in partials)
            expected *= math.exp(observed.lost_evidence)
            speeds = by_speed[0] / self._total
            self.statistics.learn(speeds, self._on_map, expected / predicted, observed.novelty)
        self._on_map = on_map / self._total
        for hypothesis, neighbour in enumerate((number - 1, number + 1)):
            if 0 <= neighbour < len(partials):
                halo = partials[neighbour].halo[hypothesis]
                self._halo[hypothesis] = halo / np.float32(self._total)
        self._last_trace = self._trace(partials)
        return self._last_trace

    def _trace(self, partials: Sequence[FilterPartial]) -> Trace:
        there = [(partial.places, partial.belief, partial.evidence) for partial in partials]
        places, belief, evidence = there[0]
        if len(there) > 1:
            places, belief, evidence = map(np.concatenate, zip(*there, strict=True))
        places, belief, evidence = normalise(places, belief, evidence, self._total)
        transit = ObservedTransition(
            places,
            np.exp(self._weights[:, None] * evidence),
            self._prior,
            self._observation.step,
            self._lost_likelihood,
            self._jump_likelihood,
            self._all_places,
        )
        observed = self._observation.novelty > 0
        lost = self._lost / self._total
        return Trace(transit, belief, lost, self._observation.displacement, observed)

    def posterior(self) -> tuple[Array, int]:
        """Return the posterior of each place, (K,), at speeds that the map resolves; and the best.

        The rest to 1 is the posterior of being at none of these places, or faster.
        """
        return resolve(self._belief, self._by_place, self._total)

    @property
    def behind(self) -> Array:
        """Posterior of each of the places before the shard, (REACH,); 0 where there are none."""
        return np.asarray(self._halo[0].sum(axis=0))
