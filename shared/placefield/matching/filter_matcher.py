"""The rule ``filter`` in one shard of a channel: its observations and its partial results."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.matching.belief_kernels import pick
from placefield.matching.best_window import Vicinity
from placefield.matching.candidate import NO_CANDIDATE, NO_PLACES, Candidate
from placefield.matching.carrying import reached_by
from placefield.matching.chains import crossed_to
from placefield.matching.comparing import Comparison, SampledPlaces
from placefield.matching.evidence_kernels import evidence_of, nearness, step_length
from placefield.matching.matcher import Matcher, Partial, SmoothedCandidate
from placefield.matching.motion import (
    REACH,
    UNKNOWN,
    Array,
    StepLengths,
)
from placefield.matching.observation import Observation
from placefield.matching.odometry import Displacement, Odometer, measures_length
from placefield.matching.partial_results import FilterPartial, fits, pack, unpack
from placefield.matching.place_filter import PlaceFilter
from placefield.matching.roads import LINE, Roads
from placefield.matching.smoother import SmoothedPosterior, Smoother
from placefield.matching.trace import NEGLIGIBLE, Trace
from placefield.search.quantized import Quantized
from placefield.search.spread import Spread, deviation_from

LEAST_PLACES = REACH
"""Least places of a shard, if there are several: a step leads to the next shard at most."""

HALO = 1
"""Places on either side of a shard's own that frames are compared with, too."""

SAMPLED = 1000
"""Size of the sample of places for the likelihood of a frame at an average place."""

UNMAPPED = 0.02
"""Unmapped places while a drive is compared with its own earlier places, see ``WholeMap``."""

_NOTHING = np.empty(0)
_TEMPERATURE = 0.8  # temperature: deviations of a frame's distances, per nat
_REPEATED = 1e-3  # distance in descriptor space up to which two frames are the same image


@dataclass(frozen=True)
class WholeMap:
    """What a filter needs of the whole map, whichever shard it has.

    Attributes:
        lengths: of steps.
        spread: of all places; None for a whole channel, whose comparisons have the deviation.
        sampled: a sample of the places; None if comparisons have all places, exactly.
        unmapped: places that the map does not have, but that the vehicle may be at, as a fraction
            of the places: each is half like every frame, under the identity metric.
        roads: where the vehicle may move.
    """

    lengths: StepLengths
    spread: Spread | None
    sampled: SampledPlaces | None
    unmapped: float = 0.0
    roads: Roads = LINE


class FilterMatcher(Matcher):
    """Filters and smooths the posterior of the places of a shard, at any speed.

    A coarse search selects the places for re-ranking in each shard by itself. That is not quite its
    selection in the whole map, so beliefs may differ slightly.
    """

    horizon = 50  # after so many missing observations, the vehicle may be anywhere
    tail = 0

    def __init__(
        self, whole: WholeMap, own: slice, number: int, smoothers: Sequence[Smoother]
    ) -> None:
        """Begin a stream.

        Args:
            whole: the data of the whole map.
            own: the shard's places in the map.
            number: index of the shard.
            smoothers: of a new stream, one for each lag.
        """
        self._filter = self._new_filter(whole, own)
        self._roads, self._odometer = whole.roads, Odometer()
        self._smoothers = smoothers
        self._lengths, self._own, self._number = whole.lengths, own, number
        self._spread, self._sampled = whole.spread, whole.sampled
        self._unmapped = whole.unmapped
        before, after = own.start > 0, own.stop < whole.lengths.apart.shape[1]
        self._halo = HALO * before, HALO * after
        self._ends = np.array([own.start, own.stop], np.int32)
        self._likely = NO_PLACES
        self._last: Quantized | None = None
        self._missed = 0  # observations in a row
        self._partial: FilterPartial | None = None
        self._trace: Trace | None = None
        self._candidate = NO_CANDIDATE
        self._smoothed: list[list[SmoothedPosterior]] = [[] for _ in smoothers]

    def _new_filter(self, whole: WholeMap, own: slice) -> PlaceFilter:
        return PlaceFilter(whole.lengths, own, whole.roads)

    def grow(self, lengths: StepLengths, vicinity: Vicinity) -> None:
        """Append places to the map, of which the shard has all.

        Args:
            lengths: of steps on the map with the new places, which are its last ones.
            vicinity: see ``Smoother``.
        """
        self._filter.grow(lengths)
        for smoother in self._smoothers:
            smoother.grow(lengths, vicinity)
        count = lengths.apart.shape[1]
        self._lengths, self._own = lengths, slice(0, count)
        self._ends = np.array([0, count], np.int32)

    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Predict the beliefs of the shard's places, and update them by the frame.

        The partial result is empty if there is no other shard, and for a repeated frame.
        """
        observation = self._observation(frame, odometry_m)
        self._partial = None if observation is None else self._filter.local(observation)
        if self._partial is None or self._spread is None:
            return _NOTHING
        return pack(self._partial)

    def _observation(
        self, frame: Comparison | None, odometry_m: float | None
    ) -> Observation | None:
        """Return the observation of a frame; None if the frame is no step of time."""
        last, self._last = self._last, None if frame is None else frame.descriptor
        self._missed = self._missed + 1 if frame is None else 0
        if self._missed == self.horizon:
            self._filter.forget()
            self._trace, self._candidate, self._likely = None, NO_CANDIDATE, NO_PLACES
        step = UNKNOWN
        if frame is not None and last is not None:
            step = step_length(frame.descriptor, last, frame.metric.unit)
            if step <= _REPEATED:
                self._last = last  # so that slow changes add up to a step
                return None
        cells = self._roads.cells
        displacement = None if cells is None else self._odometer.displacement(odometry_m)
        if frame is None:
            return self._missing(UNKNOWN, displacement) if self._filter.begun else None
        return self._observe(frame, step, displacement)

    def _missing(self, step: float, displacement: Displacement | None) -> Observation:
        places = self._own.stop - self._own.start
        return Observation(step, displacement, 0.0, np.zeros(places, np.float32), 0.0)

    def _observe(
        self, frame: Comparison, step: float, displacement: Displacement | None
    ) -> Observation:
        """Return the observation of a frame that was compared: the nearer a place, the likelier."""
        frame = self._select(frame, displacement)
        deviation = frame.deviation
        if self._spread is not None:
            deviation = deviation_from(frame.descriptor, self._spread)
        # A frame similar to the last one is not independent evidence.
        novelty = 1.0 if step < 0 else min(1.0, step / self._lengths.typical)
        cells = self._roads.cells
        if displacement is not None and cells is not None:
            step = step if measures_length(displacement, cells) else UNKNOWN
        if deviation == 0:
            return self._missing(step, displacement)
        drive = self._filter.statistics
        nats, lost_evidence = 0.5 / (_TEMPERATURE * drive.deviation(deviation)), drive.lost_evidence
        evidence = self._evidence(frame, nats, lost_evidence)
        return Observation(step, displacement, novelty, evidence, lost_evidence)

    def _select(self, frame: Comparison, displacement: Displacement | None) -> Comparison:
        """Return the comparison with exact distances to the places where the vehicle may be."""
        if frame.is_exact:
            return frame
        return frame.reranked(self._within_reach(displacement, len(frame.distances)))

    def _evidence(self, frame: Comparison, nats: float, lost_evidence: float) -> Array:
        """Return the evidence of a frame at each place of the shard, see ``Observation``.

        Args:
            frame: its comparison with these places.
            nats: by which the frame is less likely where twice the squared distance is one more.
            lost_evidence: see ``Observation``.
        """
        near = nearness(frame.distances, self._halo[0], self._own.stop - self._own.start)
        sample, every = near, -(-len(near) // SAMPLED)
        if self._sampled is not None:
            sample, every = self._sampled.nearness(frame.descriptor), 1
        most = math.log(self._lengths.apart.shape[1])
        return evidence_of(near, sample, every, nats, lost_evidence, self._unmapped, most)

    def _within_reach(self, displacement: Displacement | None, count: int) -> NDArray[np.int32]:
        """Return where the vehicle may be, among the first so many compared places."""
        trace, cells, shift = self._trace, self._roads.cells, self._halo[0] - self._own.start
        if trace is not None and displacement is not None and cells is not None:
            reached = reached_by(displacement, self._roads, trace.places) + np.int32(shift)
            return reached[(reached >= 0) & (reached < count)]
        places = within_reach(self._likely + self._halo[0], count)
        if trace is None:
            return places
        crossed = crossed_to(self._roads.chains, trace.places) + np.int32(shift)
        return np.union1d(places, crossed[(crossed >= 0) & (crossed < count)])

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Normalise the beliefs over all shards; no candidate before the first observation."""
        if self._partial is not None:
            unpacked = [self._partial]
            if self._spread is not None:
                unpacked = [unpack(partial) for partial in partials]
            self._trace = self._filter.reduce(unpacked, self._number)
            self._candidate = self._filtered()
        self._smoothed = [smoother.update(self._trace) for smoother in self._smoothers]
        return self._candidate

    def _filtered(self) -> Candidate:
        belief, best = self._filter.posterior()
        score = float(belief[best])
        own = pick(belief, min(NEGLIGIBLE, score))
        self._likely = own
        if self._number > 0:  # a step may lead from the shard before to this one
            behind = np.flatnonzero(self._filter.behind >= NEGLIGIBLE) - REACH
            self._likely = np.concatenate([behind.astype(np.int32), own])
        first = self._own.start
        return Candidate(first + best, score, first + own, belief[own], self._filter.too_fast)

    def fits(self, partial: Partial) -> bool:
        """Whether a partial result of another shard may be for this frame."""
        if self._partial is None or self._spread is None:
            return len(partial) == 0
        return fits(partial, self._lengths.apart.shape[1])

    def smoothed(self, which: int = 0) -> list[SmoothedCandidate]:
        """Return the frames that were smoothed with the last one, in order."""
        return [self._of_shard(smoothed) for smoothed in self._smoothed[which]]

    def finish(self, which: int = 0) -> list[SmoothedCandidate]:
        """Smooth all frames: the stream is over."""
        return [self._of_shard(smoothed) for smoothed in self._smoothers[which].finish()]

    def _of_shard(self, smoothed: SmoothedPosterior) -> SmoothedCandidate:
        places, belief, too_fast = smoothed.posterior
        if not len(places):
            return SmoothedCandidate(NO_CANDIDATE, smoothed.lag)
        first, end = np.searchsorted(places, self._ends).tolist()
        places, belief = places[first:end], belief[first:end]
        if not len(places):
            places, belief = np.array([self._own.start], np.int32), np.zeros(1, np.float32)
        best = int(np.argmax(belief))
        candidate = Candidate(int(places[best]), float(belief[best]), places, belief, too_fast)
        return SmoothedCandidate(candidate, smoothed.lag)


def within_reach(places: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    """Return where a step from any of these places may lead among the first so many, ascending.

    Places before the first one are negative.
    """
    reached = np.unique(np.add.outer(places, np.arange(REACH + 1, dtype=np.int32)))
    return reached[(reached >= 0) & (reached < count)]
