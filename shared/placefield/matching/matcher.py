"""Matching of one stream in one shard of a channel: comparison in, candidate out.

A shard is the places of a map from one on to another; a whole channel is shard 0 of 1. A frame
takes two steps. In the local step each shard takes the frame and returns a partial result. Given
the partial results of all shards, each then reduces them to its candidate. Joined (see
``placefield.fusion.shards``), the candidates of all shards are the one of the whole channel: to
rounding, under ``filter``.
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
"""(n,) float64, what the shards of a channel need of each other of a frame."""

WHOLE_DRIVE = sys.maxsize
"""A lag that ends with the stream: no frame is smoothed before."""


class SmoothedCandidate(NamedTuple):
    """What a channel has for a frame in hindsight.

    Attributes:
        candidate: its places are those of the map; its evidence is of the shard's only.
        lag: how many frames after it are known.
    """

    candidate: Candidate
    lag: int


class Matcher(ABC):
    """Matches one stream of frames in one shard of one channel."""

    memory: int
    """After so many missing observations, more of them change nothing that matters."""

    tail: int
    """So many missing observations come after the last frame before ``finish``."""

    @abstractmethod
    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Take the next frame, and return what the other shards need of it, (n,) float64.

        Args:
            frame: how it compares with the shard's places; None is a missing observation: the
                vehicle has moved on all the same.
            odometry_m: the odometer's reading then, metres since any fixed start; None: unknown.
                If it falls, the odometer began anew.
        """

    @abstractmethod
    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate for the frame of the last local step.

        Args:
            partials: the partial results of all shards, this one's among them, in the order of the
                map, (n,) float64 each.

        Returns:
            The candidate. Its places are those of the map; its evidence is of the shard's only.
        """

    @abstractmethod
    def fits(self, partial: Partial) -> bool:
        """Whether what came from another shard can be its partial result for this frame."""

    @abstractmethod
    def smoothed(self) -> list[SmoothedCandidate]:
        """Return the frames that were smoothed by the last reduce step, in their order.

        Every frame is smoothed once, and in the end all of them are; see ``finish``.
        """

    @abstractmethod
    def finish(self) -> list[SmoothedCandidate]:
        """Smooth the frames that are left: the stream is over."""

    def update(self, frame: Comparison | None, odometry_m: float | None = None) -> Candidate:
        """Return the candidate for the next frame; for a whole channel, which is its only shard.

        Args:
            frame: how it compares with the places; None is a missing observation.
            odometry_m: see ``local``.
        """
        return self.reduce([self.local(frame, odometry_m)])


class ReverseMatcher(Matcher):
    """Shows a matcher the places in reverse order, and turns back its candidates."""

    def __init__(self, matcher: Matcher, places: int) -> None:
        """Take the matcher, whose shard is counted from the map's end, and the map's places."""
        self._matcher = matcher
        self._places = places
        self.memory, self.tail = matcher.memory, matcher.tail

    def local(self, frame: Comparison | None, odometry_m: float | None = None) -> Partial:
        """Take the next frame, with the places in reverse order."""
        return self._matcher.local(None if frame is None else frame.turned(), odometry_m)

    def reduce(self, partials: Sequence[Partial]) -> Candidate:
        """Return the candidate in the order of the map."""
        return self._matcher.reduce(partials[::-1]).turned(self._places)

    def fits(self, partial: Partial) -> bool:
        """Whether what came from another shard can be its partial result for this frame."""
        return self._matcher.fits(partial)

    def smoothed(self) -> list[SmoothedCandidate]:
        """Return the frames that were smoothed by the last reduce step."""
        return [
            SmoothedCandidate(each.turned(self._places), lag)
            for each, lag in self._matcher.smoothed()
        ]

    def finish(self) -> list[SmoothedCandidate]:
        """Smooth the frames that are left."""
        return [
            SmoothedCandidate(each.turned(self._places), lag)
            for each, lag in self._matcher.finish()
        ]
