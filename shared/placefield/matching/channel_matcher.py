"""One channel's matching: descriptor in, candidate out."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import Rule
from placefield.maps.map import MapChannel
from placefield.matching.candidate import NO_CANDIDATE, UNANSWERED, Candidate
from placefield.matching.distances import PlaceDistances
from placefield.matching.evidence import evidence
from placefield.matching.lowest_score import lowest_score
from placefield.matching.place_filter import PlaceFilter
from placefield.matching.windows import WindowSums

_WINDOW_RULES = {"evidence": evidence, "lowest-score": lowest_score}


class ChannelMatcher(ABC):
    """Matches a stream of descriptors against a channel's places."""

    memory: int
    """After so many frames that were not seen, more of them change nothing that matters."""

    @abstractmethod
    def push(self, descriptor: NDArray[np.float32] | None) -> Candidate:
        """Return the candidate for the next frame, given its descriptor (N,).

        None is a frame that could not be seen; the vehicle has moved on all the same.
        """


class WindowMatcher(ChannelMatcher):
    """Compares windows of frames, at the same speed as the reference; one per scale."""

    def __init__(self, distances: PlaceDistances, scales: Sequence[int], rule: Rule) -> None:
        """Take the channel's metric and places, its scales (frames, ascending) and the rule."""
        self._distances = distances
        self._candidate = _WINDOW_RULES[rule]
        self._windows = WindowSums(scales, distances.count)
        self.memory = max(scales)

    def push(self, descriptor: NDArray[np.float32] | None) -> Candidate:
        """Return the candidate for the next frame; frames not seen keep the others aligned."""
        if descriptor is None:
            self._windows.push_unseen()
        else:
            self._windows.push(self._distances.to(self._distances.project(descriptor)))
        return self._candidate(self._windows)


class FilterMatcher(ChannelMatcher):
    """Filters the belief in every place, at any speed."""

    memory = 1000  # unseen for so long, the vehicle may be anywhere

    def __init__(self, distances: PlaceDistances, persistence: float) -> None:
        """Take the channel's metric and places, and how long it expects a speed to last, frames."""
        self._distances = distances
        self._filter = PlaceFilter(distances, persistence)

    def push(self, descriptor: NDArray[np.float32] | None) -> Candidate:
        """Return the candidate for the next frame; none before the first that was seen."""
        if descriptor is None:
            self._filter.push_unseen()
        else:
            projected = self._distances.project(descriptor)
            self._filter.push(projected, self._distances.to(projected))
        if not self._filter.begun:
            return NO_CANDIDATE
        belief = self._filter.belief.astype(np.float32)
        place = int(np.argmax(belief))
        return Candidate(place, float(belief[place]), belief)


class ReverseMatcher(ChannelMatcher):
    """Turns back the candidates of a matcher whose places are in reverse order."""

    def __init__(self, matcher: ChannelMatcher, places: int) -> None:
        """Take the matcher and how many places there are."""
        self._matcher = matcher
        self._last = places - 1
        self.memory = matcher.memory

    def push(self, descriptor: NDArray[np.float32] | None) -> Candidate:
        """Return the candidate for the next frame, in the order of the map."""
        turned = self._matcher.push(descriptor)
        if turned.place == UNANSWERED:
            return turned
        return Candidate(self._last - turned.place, turned.score, turned.evidence[::-1].copy())


def matcher_of(channel: MapChannel, rule: Rule, *, reverse: bool = False) -> ChannelMatcher:
    """Return a matcher of a map's channel for a new stream.

    Args:
        channel: of the map.
        rule: how candidates are made.
        reverse: whether the route is driven the other way. Windows and steps then follow the places
            in reverse order.
    """
    if not reverse:
        return _matcher(channel, channel.places, rule)
    places = np.ascontiguousarray(channel.places[::-1])
    return ReverseMatcher(_matcher(channel, places, rule), len(places))


def _matcher(channel: MapChannel, places: NDArray[np.float32], rule: Rule) -> ChannelMatcher:
    distances = PlaceDistances(channel.projection, places)
    if rule == "filter":
        # A speed lasts about as long as a segment of the route.
        return FilterMatcher(distances, float(channel.scales.mean()))
    return WindowMatcher(distances, channel.scales.tolist(), rule)
