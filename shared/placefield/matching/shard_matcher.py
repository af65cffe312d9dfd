"""Matching of one stream in a shard: the places of a map from one on to another.

A frame takes two halves. Each shard pushes it, which gives a summary for the others. With those of
all shards each finishes its candidate. Joined (see ``placefield.fusion.shards``), the candidates of
all shards are the one of a matcher of the whole map: to rounding, under ``filter``.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.matching.candidate import NO_PLACES, UNANSWERED, Candidate
from placefield.matching.channel_matcher import (
    NEXT_TO_NOTHING,
    FilterMatcher,
    candidate_of,
    turned_back,
    within_reach,
)
from placefield.matching.comparing import Comparison
from placefield.matching.filter_step import REACH
from placefield.matching.place_filter import SPEEDS, PlaceFilter, Share
from placefield.metric.spread import Spread, deviation_from

Summary = NDArray[np.float64]
"""(n,) float64, what the shards need of each other of a frame; as long for all of a channel."""


class ShardMatcher(ABC):
    """Matches one stream of frames in one shard of a channel."""

    memory: int
    """After so many frames that were not seen, more of them change nothing that matters."""

    @abstractmethod
    def push(self, frame: Comparison | None) -> Summary:
        """Take the next frame, given how it compares with the shard's places; None: not seen."""

    @abstractmethod
    def finish(self, summaries: Sequence[Summary]) -> Candidate:
        """Return the candidate for the frame that was pushed last.

        Args:
            summaries: of all shards, in their order, with this one's.

        Returns:
            Its places are those of the map; its evidence is of the shard's only.
        """


class FilterShard(ShardMatcher):
    """Filters the belief in the places of a shard.

    Where a coarse look chooses what to compare with exactly, it does so shard by shard. That is
    then not quite what it chooses in the whole map, and beliefs differ by as much.
    """

    memory = FilterMatcher.memory

    def __init__(self, place_filter: PlaceFilter, spread: Spread, first: int, number: int) -> None:
        """Take a new filter of the shard's places.

        Args:
            place_filter: of the shard.
            spread: of all places of the map.
            first: of the shard's places in the map.
            number: which of the shards it is.
        """
        self._filter = place_filter
        self._spread = spread
        self._first = first
        self._number = number
        self._believed = NO_PLACES

    def push(self, frame: Comparison | None) -> Summary:
        """Move the beliefs on and weigh them by what the shard's places have of the frame."""
        if frame is None:
            return _packed(self._filter.take_unseen())
        if not frame.is_exact:
            frame = frame.made_exact(within_reach(self._believed, len(frame.distances)))
        return _packed(self._filter.take(self._beside_all(frame)))

    def _beside_all(self, frame: Comparison) -> Comparison:
        """Give a comparison the deviation of the distances to all places of the map."""
        return replace(frame, deviation=deviation_from(frame.codes, self._spread))

    def finish(self, summaries: Sequence[Summary]) -> Candidate:
        """Bring the beliefs to what they are among all; none before the first frame seen."""
        self._filter.settle([_unpacked(summary) for summary in summaries], self._number)
        own = candidate_of(self._filter)
        if own.place == UNANSWERED:
            return own
        behind = np.flatnonzero(self._filter.behind >= NEXT_TO_NOTHING) - REACH
        self._believed = np.concatenate([behind.astype(np.int32), own.places])
        return replace(own, place=self._first + own.place, places=self._first + own.places)


def _packed(share: Share) -> Summary:
    sums = (share.nearest, share.believed, share.likelihood)
    return np.concatenate([sums, share.borders.ravel()], dtype=np.float64)


def _unpacked(summary: Summary) -> Share:
    nearest, believed, likelihood = map(float, summary[:3])
    borders = summary[3:].reshape(2, len(SPEEDS), -1).astype(np.float32)
    return Share(int(nearest), believed, likelihood, borders)


class ReverseShard(ShardMatcher):
    """Shows a shard of the places in reverse order, and turns back its candidates."""

    def __init__(self, matcher: ShardMatcher, places: int) -> None:
        """Take the shard, which is numbered from the map's end, and how many places that has."""
        self._matcher = matcher
        self._last = places - 1
        self.memory = matcher.memory

    def push(self, frame: Comparison | None) -> Summary:
        """Take the next frame in reverse order."""
        return self._matcher.push(None if frame is None else frame.turned())

    def finish(self, summaries: Sequence[Summary]) -> Candidate:
        """Return the candidate in the order of the map."""
        return turned_back(self._matcher.finish(summaries[::-1]), self._last)
