"""The rule ``filter`` in one shard of a channel: what is observed, and what shards exchange.

What the filter is, and what its shards need of each other, nobody else knows.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import MapMetric
from placefield.matching.belief_kernels import pick
from placefield.matching.candidate import NO_CANDIDATE, NO_PLACES, Candidate
from placefield.matching.comparing import Comparison, SomePlaces
from placefield.matching.evidence_kernels import bound, evidence_of, nearness, step_length
from placefield.matching.matcher import Matcher, Partial, SmoothedCandidate
from placefield.matching.motion import (
    REACH,
    UNKNOWN,
    Array,
    StepLengths,
    evenly_spaced,
    step_lengths,
)
from placefield.matching.odometry import Odometer, Road, Way, measures_length, reached_by
from placefield.matching.partial_results import Share, fits, pack, unpack
from placefield.matching.place_filter import Observation, PlaceFilter
from placefield.matching.smoother import SmoothedPosterior, Smoother
from placefield.matching.trace import NEGLIGIBLE, Trace
from placefield.search.quantized import Codes
from placefield.search.spread import Spread, deviation_from

LEAST_PLACES = REACH
"""Places that a shard has at least, if there are several: a step leads to the next one at most."""

HALO = 1
"""Places on either side of a shard's own that frames are compared with."""

SOME = 1000
"""Places that tell how likely a frame is at an average place."""

_NOTHING = np.empty(0)
_TEMPERATURE = 0.8  # deviations of a frame's distances, per nat
_RANDOM_PAIRS = 250  # places from which random pairs stand for all
_REPEATED = 1e-3  # of a descriptor: a frame that is no further from the last one is the same image


class FilterMatcher(Matcher):
    """Filters and smooths the posterior of the places of a shard, at any speed.

    Where a coarse look chooses what to compare with exactly, it does so shard by shard. That is
    then not quite what it chooses in the whole map, and beliefs differ by as much.
    """

    memory = 50  # missing for so long, the vehicle may be anywhere
    tail = 0

    def __init__(
        self,
        lengths: StepLengths,
        own: slice,
        number: int,
        smoother: Smoother,
        spread: Spread | None = None,
        road: Road | None = None,
        some: SomePlaces | None = None,
    ) -> None:
        """Begin a stream.

        Args:
            lengths: of steps on the whole map.
            own: the shard's places in the map.
            number: which of the shards it is.
            smoother: of a new stream.
            spread: of all places of the map; None where the shard has all of them, so that a
                comparison has their deviation already.
            road: the way along the whole map; None if its metres are not known.
            some: places of the map that stand for all; None where a comparison has all of them,
                exactly.
        """
        self._filter = PlaceFilter(lengths, own, road)
        self._road, self._odometer = road, Odometer()
        self._smoother = smoother
        self._lengths, self._own, self._number = lengths, own, number
        self._spread, self._some = spread, some
        before, after = own.start > 0, own.stop < lengths.apart.shape[1]
        self._halo = HALO * before, HALO * after
        self._believed = NO_PLACES
        self._last: Codes | None = None
        self._missed = 0  # observations in a row
        self._share: Share | None = None
        self._trace: Trace | None = None
        self._candidate = NO_CANDIDATE
        self._smoothed: list[SmoothedPosterior] = []

    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Predict, and update by what the shard's places have of the frame.

        The partial result is empty where there is no other shard, and for a frame that is no news.
        """
        observation = self._observation(frame, odometry_m)
        self._share = None if observation is None else self._filter.local(observation)
        if self._share is None or self._spread is None:
            return _NOTHING
        return pack(self._share)

    def _observation(
        self, frame: Comparison | None, odometry_m: float | None
    ) -> Observation | None:
        """Return what a frame shows; None if it is no step of time."""
        last, self._last = self._last, None if frame is None else frame.codes
        self._missed = self._missed + 1 if frame is None else 0
        if self._missed == self.memory:
            self._filter.forget()
            self._trace, self._candidate, self._believed = None, NO_CANDIDATE, NO_PLACES
        step = UNKNOWN
        if frame is not None and last is not None:
            step = step_length(frame.codes, last, frame.metric.unit)
            if step <= _REPEATED:
                self._last = last  # so that a slow drift shows in the end
                return None
        way = None if self._road is None else self._odometer.way(odometry_m)
        if frame is None:
            return self._missing(UNKNOWN, way) if self._filter.begun else None
        return self._observe(frame, step, way)

    def _missing(self, step: float, way: Way | None) -> Observation:
        places = self._own.stop - self._own.start
        return Observation(step, way, 0.0, np.zeros(places, np.float32), 0.0)

    def _observe(self, frame: Comparison, step: float, way: Way | None) -> Observation:
        """The nearer a place is, the likelier it is what is observed."""
        if not frame.is_exact:
            frame = frame.made_exact(self._within_reach(way, len(frame.distances)))
        deviation = frame.deviation
        if self._spread is not None:
            deviation = deviation_from(frame.codes, self._spread)
        # A frame like the last one says again what that has said.
        novelty = 1.0 if step < 0 else min(1.0, step / self._lengths.typical)
        if way is not None and self._road is not None and not measures_length(way, self._road):
            step = UNKNOWN
        if deviation == 0:
            return self._missing(step, way)
        drive = self._filter.drive
        nats = 0.5 / (_TEMPERATURE * drive.deviation(deviation))
        evidence = self._evidence(frame, nats, drive.lost_evidence)
        return Observation(step, way, novelty, evidence, drive.lost_evidence)

    def _evidence(self, frame: Comparison, nats: float, lost_evidence: float) -> Array:
        """Return the evidence of a frame at each place of the shard, see ``Observation``.

        Args:
            frame: how it compares with these places.
            nats: by which it is less likely where twice the squared distance is one more.
            lost_evidence: see ``Observation``.
        """
        near = np.empty(self._own.stop - self._own.start, np.int32)
        nearness(frame.distances, self._halo[0], near)
        some, every = near, -(-len(near) // SOME)
        if self._some is not None:
            around = self._some.distances(frame.codes)
            some, every = around[:, 1] + around.min(axis=1), 1
        evidence = np.empty(len(near), np.float32)
        evidence_of(near, some, every, nats, lost_evidence, evidence)
        bound(evidence, math.log(self._lengths.apart.shape[1]))
        return evidence

    def _within_reach(self, way: Way | None, count: int) -> NDArray[np.int32]:
        """Return where the vehicle may be, among the first so many places that are compared."""
        if way is None or self._road is None or self._trace is None:
            return within_reach(self._believed + self._halo[0], count)
        reached = reached_by(way, self._road, self._trace.places)
        reached += np.int32(self._halo[0] - self._own.start)
        return reached[(reached >= 0) & (reached < count)]

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Bring the beliefs to what they are among all; none before the first observation."""
        if self._share is not None:
            shares = [self._share]
            if self._spread is not None:
                shares = [unpack(partial) for partial in partials]
            self._trace = self._filter.reduce(shares, self._number)
            self._candidate = self._filtered()
        self._smoothed = self._smoother.update(self._trace)
        return self._candidate

    def _filtered(self) -> Candidate:
        belief, best = self._filter.posterior()
        picked = np.empty(len(belief), np.int32)
        own = picked[: pick(belief, min(NEGLIGIBLE, float(belief[best])), picked)].copy()
        self._believed = own
        if self._number > 0:  # a step may lead here from the shard before
            behind = np.flatnonzero(self._filter.behind >= NEGLIGIBLE) - REACH
            self._believed = np.concatenate([behind.astype(np.int32), own])
        first = self._own.start
        return Candidate(
            first + best, float(belief[best]), first + own, belief[own], self._filter.too_fast
        )

    def fits(self, partial: Partial) -> bool:
        """Whether what came from another shard can be its partial result for this frame."""
        if self._share is None or self._spread is None:
            return len(partial) == 0
        return fits(partial, self._lengths.apart.shape[1])

    def smoothed(self) -> list[SmoothedCandidate]:
        """Return the frames that were smoothed with the last one, in order."""
        return [self._of_shard(smoothed) for smoothed in self._smoothed]

    def finish(self) -> list[SmoothedCandidate]:
        """Smooth all frames: the stream is over."""
        return [self._of_shard(smoothed) for smoothed in self._smoother.finish()]

    def _of_shard(self, smoothed: SmoothedPosterior) -> SmoothedCandidate:
        places, belief, too_fast = smoothed.posterior
        if not len(places):
            return SmoothedCandidate(NO_CANDIDATE, smoothed.lag)
        first, end = np.searchsorted(places, (self._own.start, self._own.stop))
        places, belief = places[first:end], belief[first:end]
        if not len(places):
            places, belief = np.array([self._own.start], np.int32), np.zeros(1, np.float32)
        best = int(np.argmax(belief))
        candidate = Candidate(int(places[best]), float(belief[best]), places, belief, too_fast)
        return SmoothedCandidate(candidate, smoothed.lag)


def lengths_of(metric: MapMetric, *, reverse: bool) -> StepLengths:
    """Return how long steps are on a map, in the order in which it is driven."""
    apart = _reversed_steps(metric.steps) if reverse else metric.steps
    return step_lengths(np.array(apart), jumps_of(metric))  # what is mapped is read-only


def jumps_of(metric: MapMetric) -> Array:
    """Return how far places are from those half a map away, (J,) float32."""
    count = len(metric.places)
    some = evenly_spaced(np.arange(count), _RANDOM_PAIRS)
    here, there = metric.places[some], metric.places[some - count // 2]
    difference = here.astype(np.float32) - there
    return np.asarray(metric.unit * np.linalg.norm(difference, axis=1), np.float32)


def within_reach(places: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    """Return where a step from any of these places may lead among the first so many, ascending.

    Places before the first of all are negative.
    """
    reached = np.unique(np.add.outer(places, np.arange(REACH + 1, dtype=np.int32)))
    return reached[(reached >= 0) & (reached < count)]


def _reversed_steps(steps: Array) -> Array:
    """How far each place is from those behind it, in reverse order."""
    turned = steps[:, ::-1].copy()
    for step, row in enumerate(turned, 1):
        some = min(step, len(row))
        row[some:], row[:some] = row[: len(row) - some].copy(), row[len(row) - some :].copy()
    return turned
