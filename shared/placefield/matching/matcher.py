"""Matching of one stream in one shard of a channel: comparisons in, candidates out.

A shard is a range of places of a map; a whole channel is shard 0 of 1. A frame takes two steps. In
the local step each shard processes the frame and returns a partial result. In the reduce step each
shard combines the partial results of all shards into its candidate. The joined candidates of all
shards (see ``placefield.fusion.shard_joiner``) are the candidate of the whole channel; under
``filter`` only up to rounding.
"""

import sys
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.candidate import Candidate
from placefield.matching.comparing import Comparison

Partial = NDArray[np.float64]
"""(n,) float64, the partial result of a shard for a frame, which the other shards need."""

WHOLE_DRIVE = sys.maxsize
"""A lag that lasts until the stream ends: all frames are smoothed then."""


class SmoothedCandidate(NamedTuple):
    """A channel's smoothed candidate for a frame.

    Attributes:
        candidate: its places are those of the map; its evidence is of the shard's only.
        lag: number of later frames that it uses.
    """

    candidate: Candidate
    lag: int


class Matcher(ABC):
    """Matches one stream of frames in one shard of one channel, and smooths it with some lags."""

    horizon: int
    """After so many missing observations in a row, more of them make no difference."""

    tail: int
    """Number of missing observations to add after the last frame, before ``finish``."""

    @abstractmethod
    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Process the next frame, and return the shard's partial result, (n,) float64.

        Args:
            frame: its comparison with the shard's places; None is a missing observation, during
                which the vehicle may move.
            odometry_m: the odometer's reading at the frame, metres since any fixed start; None:
                unknown. If it falls, the odometer began anew.
        """

    @abstractmethod
    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate for the frame of the last local step.

        Args:
            partials: the partial results of all shards, including this one, in the order of the
                map, (n,) float64 each.

        Returns:
            The candidate. Its places are those of the map; its evidence is of the shard's only.
        """

    @abstractmethod
    def fits(self, partial: Partial) -> bool:
        """Whether a partial result of another shard may be for this frame."""

    @abstractmethod
    def smoothed(self, which: int = 0) -> list[SmoothedCandidate]:
        """Return the frames that were smoothed by the last reduce step, in their order.

        Every frame is smoothed once with each lag, the last ones by ``finish``.

        Args:
            which: index of the lag among those of the matcher.
        """

    @abstractmethod
    def finish(self, which: int = 0) -> list[SmoothedCandidate]:
        """Smooth the remaining frames: the stream is over. See ``smoothed``."""

    def update(self, frame: Comparison | None, odometry_m: float | None = None) -> Candidate:
        """Return the candidate for the next frame of a whole channel, which is the only shard.

        Args:
            frame: its comparison with the places; None is a missing observation.
            odometry_m: see ``local``.
        """
        return self.reduce([self.local(frame, odometry_m)])


class ReverseMatcher(Matcher):
    """Gives a matcher the places in reverse order, and converts its candidates back."""

    def __init__(self, matcher: Matcher, places: int) -> None:
        """Wrap a matcher whose shard is counted from the map's end, of a map of so many places."""
        self._matcher = matcher
        self._places = places
        self.horizon, self.tail = matcher.horizon, matcher.tail

    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Process the next frame, with the places in reverse order."""
        return self._matcher.local(None if frame is None else frame.reversed(), odometry_m)

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate in the order of the map."""
        return self._matcher.reduce(partials[::-1]).reversed(self._places)

    def fits(self, partial: Partial) -> bool:
        """Whether a partial result of another shard may be for this frame."""
        return self._matcher.fits(partial)

    def smoothed(self, which: int = 0) -> list[SmoothedCandidate]:
        """Return the frames that were smoothed by the last reduce step."""
        return self._in_order(self._matcher.smoothed(which))

    def finish(self, which: int = 0) -> list[SmoothedCandidate]:
        """Smooth the remaining frames."""
        return self._in_order(self._matcher.finish(which))

    def _in_order(self, smoothed: list[SmoothedCandidate]) -> list[SmoothedCandidate]:
        return [SmoothedCandidate(each.reversed(self._places), lag) for each, lag in smoothed]
