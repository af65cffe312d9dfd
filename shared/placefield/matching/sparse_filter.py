"""The filter of a large map: beliefs only where there is belief.

The likeliest places are kept from frame to frame, each with its own belief. All other places share
one belief, their mean. Of a frame, those places are active that a step from the kept ones may lead
to, and those that an index proposes because they resemble the frame. A sample of the other places
says how well the frame resembles those. The rest is as in ``placefield.matching.place_filter``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.active_carrying import (
    carried_to_active,
    reached_in_both_ways,
    staying,
)
from placefield.matching.active_places import Surroundings, active_places
from placefield.matching.candidate import NO_PLACES
from placefield.matching.filter_kernels import Transition, advance
from placefield.matching.motion import LOSE, REACH, SPEEDS, Array, StepLengths
from placefield.matching.observation import Observation
from placefield.matching.odometry import Displacement
from placefield.matching.odometry_kernel import OdometryTransition, spread
from placefield.matching.partial_results import FilterPartial
from placefield.matching.place_filter import PlaceFilter
from placefield.matching.roads import LINE, Roads, RouteCells
from placefield.matching.trace import MOST_PLACES
from placefield.search.inverted import least_of

KEPT = MOST_PLACES
"""Most places that are kept from frame to frame: as many as the smoother knows."""

Vector = NDArray[np.float64]
Places = NDArray[np.int32]


class _Part(NamedTuple):
    """Some places of a map.

    Attributes:
        belief: (2, S, n) float32, before the frame; receives the beliefs after it.
        apart: (6, n) float32, see ``StepLengths``.
        evidence: (n,) float32, see ``Observation``.
    """

    belief: Array
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
            roads: of the map.
        """
        super().__init__(lengths, slice(0, 0), roads)
        self._sample, self._apart_of_sample = sample, np.take(lengths.apart, sample, axis=1)

    def forget(self) -> None:
        """Reset the beliefs: the vehicle may be anywhere. The statistics of the drive stay."""
        self._belief = np.empty((2, len(SPEEDS), 0), np.float32)
        super().forget()
        self.kept: Places = NO_PLACES
        """The places that are kept, (m,) int32, ascending."""
        # The sums of the beliefs in all other places, (2, S).
        self._pool: Vector = self._all_places * self._anywhere(0.5 * self._unlearned).astype(float)

    @property
    def is_lost(self) -> bool:
        """Whether the vehicle is less likely at the kept places than elsewhere or lost."""
        return float(self._by_place[0].sum()) < 0.5 * self._total

    def activate(self, proposed: Places, displacement: Displacement | None) -> Places:
        """Return the active places of the next frame, (n,) int32, ascending.

        Args:
            proposed: (m,) int32, places that resemble the frame.
            displacement: to the frame; None if the odometry is not known.
        """
        if not len(self.kept) and not len(proposed):
            proposed = np.zeros(1, np.int32)
        if displacement is not None and self._roads.cells is not None:
            reached = reached_in_both_ways(displacement, self._roads, self.kept)
            proposed = np.concatenate([proposed, reached])
        chains = self._roads.chains
        self._active = active_places(self.kept, proposed, chains, self._all_places)
        return self._active.places

    def local(self, observation: Observation) -> FilterPartial:
        """Predict the beliefs of all places, and update them by the frame.

        Args:
            observation: its evidence is that of the sample, then that of the active places.
        """
        self._weigh(observation)
        own, rest = self._parts(observation.evidence)
        cells, displacement = self._roads.cells, observation.displacement
        if not self.begun:
            self._predict_nothing()
            of_own, of_rest = self._at_first(own), self._at_first(rest)
        elif cells is not None and displacement is not None:
            of_own, of_rest = self._by_odometry(own, rest, displacement, cells)
        else:
            of_own, of_rest = self._by_motion(own, rest)
        return self._partial(own, of_own, of_rest)

    def _parts(self, evidence: Array) -> tuple[_Part, _Part]:
        """Return the active places, and those of the sample that are not active."""
        places, count = self._active.places, len(self._sample)
        at = np.minimum(np.searchsorted(places, self._sample), len(places) - 1)
        others = np.flatnonzero(places[at] != self._sample)
        if not len(others):  # then hardly any places are left that they represent
            others = np.arange(count)
        self._elsewhere = self._pool / max(self._all_places - len(self.kept), 1)
        belief = self._as_elsewhere(len(places))
        belief[:, :, np.searchsorted(places, self.kept)] = self._belief
        own = _Part(belief, np.take(self._lengths.apart, places, axis=1), evidence[count:])
        belief = self._as_elsewhere(len(others))
        apart = np.take(self._apart_of_sample, others, axis=1)
        return own, _Part(belief, apart, evidence[:count][others])

    def _as_elsewhere(self, places: int) -> Array:
        """Return beliefs of so many places, (2, S, n), each as that of a place that is not kept."""
        return np.repeat(self._elsewhere[:, :, None].astype(np.float32), places, axis=2)

    def _ratios(self, part: _Part) -> tuple[Array, Array]:
        """Return the likelihood ratios of the frame, and those if all of the evidence counts."""
        ratios = np.exp(self._weights[:, None] * part.evidence)
        return ratios, ratios[1] if self._weights[1] == 1 else np.exp(part.evidence)

    def _at_first(self, part: _Part) -> _Sums:
        """Update the beliefs of a part by the first frame, without a prediction."""
        part.belief[:] *= self._ratios(part)[0][1]
        by_speed = part.belief.sum(axis=2, dtype=np.float64)
        return _Sums(0.0, 0.0, by_speed, part.belief.sum(axis=1))

    def _by_motion(self, own: _Part, rest: _Part) -> tuple[_Sums, _Sums]:
        """Predict by the motion model, and update."""
        transition, kept = self._predict_lost(), np.float32((1 - LOSE) / self._total)
        chains, elsewhere = self._roads.chains, self._elsewhere.astype(np.float32)
        halos = kept * Surroundings(self._active, own.belief, elsewhere).halos(chains)
        of_own = self._advanced(own, self._active.pieces, halos, transition)
        whole = np.array([0, rest.belief.shape[2]], np.int32)
        halos = kept * self._as_elsewhere(REACH)[None]
        return of_own, self._advanced(rest, whole, halos, transition)

    def _advanced(self, part: _Part, pieces: Places, halos: Array, transition: Transition) -> _Sums:
        by_place, by_speed = part.belief.sum(axis=1), np.empty((2, len(SPEEDS)))
        predicted, expected = advance(
            part.belief,
            pieces,
            halos,
            transition,
            part.apart,
            *self._ratios(part),
            by_place,
            by_speed,
        )
        return _Sums(predicted, expected, by_speed, by_place)

    def _by_odometry(
        self, own: _Part, rest: _Part, displacement: Displacement, cells: RouteCells
    ) -> tuple[_Sums, _Sums]:
        """Predict by odometry, and update."""
        transition = self._predict_lost_by_odometry(displacement.pace / cells.spacing)
        kept = np.float32((1 - LOSE) / self._total)
        stays = staying(self._roads, displacement)
        elsewhere = np.outer((stays, 1 - stays), kept * self._elsewhere.sum(axis=1))
        elsewhere = elsewhere[:, :, None].astype(np.float32)  # from where no place is kept
        carried = elsewhere + carried_to_active(
            self._active.places, (self.kept, kept * self._by_place), self._roads, displacement
        )
        of_own = self._spread(own, carried, transition)
        carried = np.repeat(elsewhere, rest.belief.shape[2], axis=2)
        return of_own, self._spread(rest, carried, transition)

    def _spread(self, part: _Part, carried: Array, transition: OdometryTransition) -> _Sums:
        by_place = np.empty((2, carried.shape[2]), np.float32)
        by_speed = np.empty((2, len(SPEEDS)))
        predicted, expected = spread(
            part.belief,
            carried,
            self._step_likelihoods(part.apart, transition.pace),
            transition.speeds,
            transition.found,
            *self._ratios(part),
            by_place,
            by_speed,
        )
        return _Sums(predicted, expected, by_speed, by_place)

    def _partial(self, own: _Part, of_own: _Sums, of_rest: _Sums) -> FilterPartial:
        """Keep the likeliest places, and return the sums over all places."""
        share = (self._all_places - len(self._active.places)) / of_rest.by_place.shape[1]
        rows = least_of(-of_own.by_place.sum(axis=0), KEPT)
        self.kept, self._belief = self._active.places[rows], np.take(own.belief, rows, axis=2)
        self._by_place = np.take(of_own.by_place, rows, axis=1)
        belief = np.ascontiguousarray(self._belief.transpose(2, 0, 1))
        own.belief[:, :, rows] = 0
        self._pool = own.belief.sum(axis=2, dtype=np.float64) + share * of_rest.by_speed
        return FilterPartial(
            of_own.predicted + share * of_rest.predicted,
            of_own.expected + share * of_rest.expected,
            of_own.by_speed + share * of_rest.by_speed,
            self._halo,
            self.kept,
            own.evidence[rows],
            belief,
        )
