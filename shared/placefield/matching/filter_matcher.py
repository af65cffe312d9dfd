"""The rule ``filter`` in one shard of a channel; see ``placefield.matching.place_filter``.

What the filter is, and what its shards need of each other, nobody else knows.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.candidate import NO_CANDIDATE, NO_PLACES, Candidate
from placefield.matching.comparing import Comparison
from placefield.matching.filter_step import REACH
from placefield.matching.matcher import Matcher, Partial
from placefield.matching.place_filter import (
    NO_BORDERS,
    SPEEDS,
    STEPS,
    Array,
    PlaceFilter,
    Share,
    evenly_spaced,
)
from placefield.metric.spread import Spread, deviation_from

NEXT_TO_NOTHING = 1e-6
"""A belief below this is left out of a candidate: no sum of a few of them changes a match."""

LEAST_PLACES = REACH
"""Places that a shard has at least, if there are several: a step leads to the next one at most."""


class FilterModel(NamedTuple):
    """What ``PlaceFilter`` takes of a channel.

    Attributes:
        steps: (2, K) float32, how far each place is from the one before it, and from the one before
            that.
        jumps: (J,) float32, how far places are from those half a map away.
        persistence: how many frames a speed lasts, on average.
    """

    steps: Array
    jumps: Array
    persistence: float


class FilterMatcher(Matcher):
    """Filters the belief in the places of a shard, at any speed.

    Where a coarse look chooses what to compare with exactly, it does so shard by shard. That is
    then not quite what it chooses in the whole map, and beliefs differ by as much.
    """

    memory = 1000  # missing for so long, the vehicle may be anywhere

    def __init__(
        self, model: FilterModel, own: slice, number: int, spread: Spread | None = None
    ) -> None:
        """Begin a stream.

        Args:
            model: of the whole channel.
            own: the shard's places in the map.
            number: which of the shards it is.
            spread: of all places of the map; None where the shard has all of them, so that a
                comparison has their deviation already.
        """
        self._filter = PlaceFilter(*model, own)
        self._first = own.start
        self._number = number
        self._spread = spread
        self._believed = NO_PLACES

    def local(self, frame: Comparison | None) -> Partial:
        """Predict, and weigh the beliefs by what the shard's places have of the frame."""
        if frame is None:
            return _packed(self._filter.take_unseen())
        if not frame.is_exact:
            frame = frame.made_exact(within_reach(self._believed, len(frame.distances)))
        if self._spread is not None:
            frame = replace(frame, deviation=deviation_from(frame.codes, self._spread))
        return _packed(self._filter.take(frame))

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Bring the beliefs to what they are among all; none before the first observation."""
        self._filter.settle([_unpacked(partial) for partial in partials], self._number)
        if not self._filter.begun:
            return NO_CANDIDATE
        best, own, beliefs = self._filter.believed(NEXT_TO_NOTHING)
        self._believed = own
        if self._number > 0:  # a step may lead here from the shard before
            behind = np.flatnonzero(self._filter.behind >= NEXT_TO_NOTHING) - REACH
            self._believed = np.concatenate([behind.astype(np.int32), own])
        places = self._first + own
        return Candidate(int(places[best]), float(beliefs[best]), places, beliefs)


def filter_model(channel: MapChannel, *, reverse: bool) -> FilterModel:
    """Return what the filter takes of a channel.

    Args:
        channel: of the map.
        reverse: whether the route is driven the other way; the places are then in reverse order.
    """
    metric = channel.metric
    steps = _reversed_steps(metric.steps) if reverse else metric.steps
    # A speed lasts about as long as a segment of the route.
    return FilterModel(steps, jumps_of(metric), float(channel.scales.mean()))


def jumps_of(metric: MapMetric) -> Array:
    """Return how far places are from those half a map away, (J,) float32."""
    count = len(metric.places)
    some = evenly_spaced(np.arange(count))
    here, there = metric.places[some], metric.places[some - count // 2]
    difference = here.astype(np.float32) - there
    return np.asarray(metric.unit * np.linalg.norm(difference, axis=1), np.float32)


def within_reach(places: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    """Return where a step from any of these places may lead among the first so many, ascending.

    Places before the first of all are negative.
    """
    reached = np.unique(np.add.outer(places, np.array(STEPS, np.int32)))
    return reached[(reached >= 0) & (reached < count)]


def _reversed_steps(steps: Array) -> Array:
    """How far each place is from the one and the two behind it, in reverse order."""
    turned = steps[:, ::-1].copy()
    for row, step in zip(turned, (1, 2), strict=True):
        row[step:], row[:step] = row[:-step].copy(), row[-step:].copy()
    return turned


def _packed(share: Share) -> Partial:
    sums = np.array((share.nearest, share.believed, share.likelihood), np.float64)
    return np.concatenate([sums, share.borders.ravel()]) if share.borders.size else sums


def _unpacked(partial: Partial) -> Share:
    nearest, believed, likelihood, *borders = partial.tolist()
    halo = np.array(borders, np.float32).reshape(2, len(SPEEDS), -1) if borders else NO_BORDERS
    return Share(int(nearest), believed, likelihood, halo)
