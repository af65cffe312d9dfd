"""One channel's matching: descriptor in, candidate out."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import Rule
from placefield.maps.map import MapChannel
from placefield.matching.candidate import Candidate
from placefield.matching.distances import PlaceDistances
from placefield.matching.evidence import evidence
from placefield.matching.lowest_score import lowest_score
from placefield.matching.windows import WindowSums

_RULES = {"evidence": evidence, "lowest-score": lowest_score}


class ChannelMatcher:
    """Matches a stream of descriptors against a channel's places, at the channel's scales."""

    def __init__(self, distances: PlaceDistances, scales: Sequence[int], rule: Rule) -> None:
        """Take the channel's metric and places, its scales (frames, ascending) and the rule."""
        self._distances = distances
        self._candidate = _RULES[rule]
        self._windows = WindowSums(scales, distances.count)

    @property
    def longest_scale(self) -> int:
        """Frames; what is further back has no influence."""
        return max(self._windows.lengths)

    def push(self, descriptor: NDArray[np.float32] | None) -> Candidate:
        """Return the candidate for the next frame, given its descriptor (N,).

        None is a frame that could not be seen; the vehicle has moved on all the same, so that the
        frames around it stay on one diagonal.
        """
        if descriptor is None:
            self._windows.push_unseen()
        else:
            self._windows.push(self._distances.to(descriptor))
        return self._candidate(self._windows)


def matcher_of(channel: MapChannel, rule: Rule) -> ChannelMatcher:
    """Return a matcher of a map's channel for a new stream."""
    distances = PlaceDistances(channel.projection, channel.places)
    return ChannelMatcher(distances, channel.scales.tolist(), rule)
