"""The filter of a large map: beliefs only where there is belief.

The likeliest places are kept from frame to frame, each with its own belief. All other places share
one belief, their mean. Of a frame, those places are active that a step from the kept ones may lead
to, and those that an index proposes because they resemble the frame. A sample of the other places
says how well the frame resembles those. The rest is as in ``placefield.matching.place_filter``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.active_places import Surroundings, active_places
from placefield.matching.belief_kernels import beliefs_at
from placefield.matching.candidate import NO_PLACES
from placefield.matching.filter_kernels import Transition, advance
from placefield.matching.motion import LOSE, REACH, SPEEDS, Array, StepLengths
from placefield.matching.observation import Observation
from placefield.matching.partial_results import FilterPartial
from placefield.matching.place_filter import PlaceFilter
from placefield.matching.roads import LINE, Roads
from placefield.search.inverted import least_of

KEPT = 512
"""Most places that are kept from frame to frame."""

Vector = NDArray[np.float64]
Places = NDArray[np.int32]


class _Part(NamedTuple):
    """Some places, with their beliefs before a frame and their evidence.

    Attributes:
        belief: (2, S, n) float32; receives the beliefs after the frame.
        pieces: see ``advance``.
        halos: see ``advance``, but not times ``kept``.
        apart: (6, n) float32, see ``StepLengths``.
        evidence: (n,) float32, see ``Observation``.
    """

    belief: Array
    pieces: Places
    halos: Array
    apart: Array
    evidence: Array


class _Sums(NamedTuple):
    """Sums over some places, see ``FilterPartial``, and the beliefs by place, (2, n) float32."""

    predicted: float
    expected: float
    by_speed: Vector
    by_place: Array


class SparseFilter(PlaceFilter):
    """The posterior of the likeliest places of a whole map, given the frames so far."""

    def __init__(self, lengths: StepLengths, sample: Places, roads: Roads = LINE) -> None:
        """Prepare for a new stream.

        Args:
            lengths: of steps on the map.
            sample: (J,) int32, places that represent the map.
            roads: of the map, whose metres are not known.
        """
        super().__init__(lengths, slice(0, 0), roads)
        self._sample, self._apart_of_sample = sample, lengths.apart[:, sample]

    def forget(self) -> None:
        """Reset the beliefs: the vehicle may be anywhere. The statistics of the drive stay."""
        self._belief = np.empty((2, len(SPEEDS), 0), np.float32)
        super().forget()
        self.kept: Places = NO_PLACES
        """The places that are kept, (m,) int32, ascending."""
        self._pool: Vector = self._all_places * self._anywhere(0.5 * self._unlearned).astype(float)

    @property
    def is_lost(self) -> bool:
        """Whether the vehicle is less likely at the kept places than elsewhere or lost."""
        return float(self._by_place[0].sum()) < 0.5 * self._total

    def activate(self, proposed: Places) -> Places:
        """Return the active places of the next frame, (n,) int32, ascending.

        Args:
            proposed: (m,) int32, places that resemble the frame.
        """
        if not len(self.kept) and not len(proposed):
            proposed = np.zeros(1, np.int32)
        chains = self._roads.chains
        self._active = active_places(self.kept, proposed, chains, self._all_places)
        return self._active.places

    def local(self, observation: Observation) -> FilterPartial:
        """Predict the beliefs of all places, and update them by the frame.

        Args:
            observation: its evidence is that of the sample, then that of the active places.
        """
        self._weigh(observation)
        transition = self._predict_lost() if self.begun else None
        own, rest = self._parts(observation.evidence)
        of_own, of_rest = self._update(own, transition), self._update(rest, transition)
        share = (self._all_places - len(self._active.places)) / rest.belief.shape[2]
        by_speed = of_own.by_speed + share * of_rest.by_speed
        both = of_own.by_place[0] + of_own.by_place[1]
        rows = least_of(-both, KEPT)
        self.kept, self._belief = self._active.places[rows], own.belief[:, :, rows]
        self._by_place = of_own.by_place[:, rows]
        own.belief[:, :, rows] = 0
        self._pool = own.belief.sum(axis=2, dtype=np.float64) + share * of_rest.by_speed
        if transition is None:
            self._predict_nothing()
        return FilterPartial(
            of_own.predicted + share * of_rest.predicted,
            of_own.expected + share * of_rest.expected,
            by_speed,
            self._halo,
            self.kept,
            own.evidence[rows],
            beliefs_at(self._belief, np.arange(len(rows), dtype=np.int32)),
        )

    def _parts(self, evidence: Array) -> tuple[_Part, _Part]:
        """Return the active places, and those of the sample that are not active."""
        places, count = self._active.places, len(self._sample)
        at = np.minimum(np.searchsorted(places, self._sample), len(places) - 1)
        others = np.flatnonzero(places[at] != self._sample)
        if not len(others):
            others = np.arange(count)
        elsewhere = (self._pool / max(self._all_places - len(self.kept), 1)).astype(np.float32)
        belief = _everywhere(elsewhere, len(places))
        belief[:, :, np.searchsorted(places, self.kept)] = self._belief
        halos = Surroundings(self._active, belief, elsewhere).halos(self._roads.chains)
        apart = self._lengths.apart[:, places]
        own = _Part(belief, self._active.pieces, halos, apart, evidence[count:])
        rest = _Part(
            _everywhere(elsewhere, len(others)),
            np.array([0, len(others)], np.int32),
            _everywhere(elsewhere, REACH)[None],
            self._apart_of_sample[:, others],
            evidence[:count][others],
        )
        return own, rest

    def _update(self, part: _Part, transition: Transition | None) -> _Sums:
        """Predict and update the beliefs of some places; without a transition only update them."""
        belief, pieces, halos, apart, evidence = part
        ratios = np.exp(self._weights[:, None] * evidence)
        by_speed = np.empty(belief.shape[:2])
        by_place = belief.sum(axis=1)
        if transition is None:
            belief *= ratios[1]
            sums = belief.sum(axis=2, dtype=np.float64)
            return _Sums(0.0, 0.0, sums, belief.sum(axis=1))
        full_ratio = ratios[1] if self._weights[1] == 1 else np.exp(evidence)
        halos *= np.float32((1 - LOSE) / self._total)
        predicted, expected = advance(
            belief, pieces, halos, transition, apart, ratios, full_ratio, by_place, by_speed
        )
        return _Sums(predicted, expected, by_speed, by_place)


def _everywhere(belief: Array, places: int) -> Array:
    """Return the beliefs in so many places, (2, S, n), of which each has the same, (2, S)."""
    return np.repeat(belief[:, :, None], places, axis=2)
