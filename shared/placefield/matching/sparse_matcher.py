"""The rule ``filter`` on a large map: places are proposed by an index, see ``SparseFilter``."""

import math

import numpy as np
from numpy.typing import NDArray

from placefield.matching.candidate import NO_PLACES, Candidate
from placefield.matching.comparing import Comparison
from placefield.matching.evidence_kernels import evidence_of
from placefield.matching.filter_matcher import SAMPLED, FilterMatcher, WholeMap
from placefield.matching.motion import Array, evenly_spaced
from placefield.matching.observation import Observation
from placefield.matching.odometry import Displacement
from placefield.matching.sparse_filter import SparseFilter
from placefield.matching.trace import NEGLIGIBLE
from placefield.search.inverted import distinct

PROPOSED = 512
"""Places that the index proposes for a frame."""

LISTS, LISTS_WHEN_LOST = 128, 512
"""Lists of the index that are read for a frame, and for one of a lost vehicle."""


class SparseMatcher(FilterMatcher):
    """Filters and smooths the posterior of the likeliest places of a whole map."""

    _filter: SparseFilter

    def _new_filter(self, whole: WholeMap, own: slice) -> SparseFilter:
        sample = evenly_spaced(np.arange(own.stop, dtype=np.int32), SAMPLED)
        self._sample_size, self._active = len(sample), NO_PLACES
        return SparseFilter(whole.lengths, sample, whole.roads)

    def _select(self, frame: Comparison, displacement: Displacement | None) -> Comparison:
        lists = LISTS_WHEN_LOST if self._filter.is_lost else LISTS
        self._active = self._filter.activate(frame.nearest(lists, PROPOSED), displacement)
        return frame

    def _missing(self, step: float, displacement: Displacement | None) -> Observation:
        active = self._filter.activate(NO_PLACES, displacement)
        evidence = np.zeros(self._sample_size + len(active), np.float32)
        return Observation(step, displacement, 0.0, evidence, 0.0)

    def _evidence(self, frame: Comparison, nats: float, lost_evidence: float) -> Array:
        """Return the evidence of a frame at the places of the sample, then at the active ones."""
        assert self._sampled is not None
        sample, last = self._sampled.nearness(frame.descriptor), self._own.stop - 1
        near = np.concatenate([sample, _nearness(frame, self._active, last)])
        most = math.log(self._own.stop)
        return evidence_of(near, sample, 1, nats, lost_evidence, self._unmapped, most)

    def _filtered(self) -> Candidate:
        belief, best = self._filter.posterior()
        picked, kept = belief >= min(NEGLIGIBLE, float(belief[best])), self._filter.kept
        return Candidate(
            int(kept[best]),
            float(belief[best]),
            kept[picked],
            belief[picked],
            self._filter.too_fast,
        )


def _nearness(frame: Comparison, places: NDArray[np.int32], last: int) -> NDArray[np.int32]:
    """Return the nearness of a frame to some places, (n,), see ``evidence_kernels.nearness``."""
    around = np.add.outer(places, np.arange(-1, 2, dtype=np.int32))
    around = distinct(np.clip(around, 0, last).ravel())
    distances, here = frame.distances_to(around), np.searchsorted(around, places)
    own, final = distances[here], len(around) - 1
    before, after = distances[np.maximum(here - 1, 0)], distances[np.minimum(here + 1, final)]
    return np.asarray(own + np.minimum(own, np.minimum(before, after)))
