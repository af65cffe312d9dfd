"""One channel's matching of one stream: comparison in, candidate out."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import Rule
from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.candidate import NO_CANDIDATE, NO_PLACES, UNANSWERED, Candidate
from placefield.matching.comparing import Comparison
from placefield.matching.evidence import evidence
from placefield.matching.lowest_score import lowest_score
from placefield.matching.place_filter import STEPS, Array, PlaceFilter, evenly_spaced
from placefield.matching.windows import WindowSums

_WINDOW_RULES = {"evidence": evidence, "lowest-score": lowest_score}

NEXT_TO_NOTHING = 1e-6
"""A belief below this is not told: no sum of a few of them changes a match."""


class ChannelMatcher(ABC):
    """Matches one stream of frames in one channel."""

    memory: int
    """After so many frames that were not seen, more of them change nothing that matters."""

    @abstractmethod
    def push(self, frame: Comparison | None) -> Candidate:
        """Return the candidate for the next frame, given how it compares with the places.

        None is a frame that could not be seen; the vehicle has moved on all the same.
        """


class WindowMatcher(ChannelMatcher):
    """Compares windows of frames, at the same speed as the reference; one per scale."""

    def __init__(self, metric: MapMetric, scales: Sequence[int], rule: Rule) -> None:
        """Take the channel's metric, its scales (frames, ascending) and the rule."""
        self._candidate = _WINDOW_RULES[rule]
        self._windows = WindowSums(scales, len(metric.places), metric.unit)
        self.memory = max(scales)

    def push(self, frame: Comparison | None) -> Candidate:
        """Return the candidate for the next frame; frames not seen keep the others aligned."""
        if frame is None:
            self._windows.push_unseen()
        else:
            self._windows.push(frame.distances)
        return self._candidate(self._windows)


class FilterMatcher(ChannelMatcher):
    """Filters the belief in every place, at any speed."""

    memory = 1000  # unseen for so long, the vehicle may be anywhere

    def __init__(self, steps: Array, jumps: Array, persistence: float) -> None:
        """Take what ``PlaceFilter`` takes."""
        self._filter = PlaceFilter(steps, jumps, persistence)
        self._believed = NO_PLACES

    def push(self, frame: Comparison | None) -> Candidate:
        """Return the candidate for the next frame; none before the first that was seen."""
        if frame is None:
            self._filter.push_unseen()
        else:
            if not frame.is_exact:
                frame = frame.made_exact(within_reach(self._believed, len(frame.distances)))
            self._filter.push(frame)
        candidate = candidate_of(self._filter)
        self._believed = candidate.places
        return candidate


class ReverseMatcher(ChannelMatcher):
    """Shows a matcher the places in reverse order, and turns back its candidates."""

    def __init__(self, matcher: ChannelMatcher, places: int) -> None:
        """Take the matcher and how many places there are."""
        self._matcher = matcher
        self._last = places - 1
        self.memory = matcher.memory

    def push(self, frame: Comparison | None) -> Candidate:
        """Return the candidate for the next frame, in the order of the map."""
        turned = self._matcher.push(None if frame is None else frame.turned())
        return turned_back(turned, self._last)


def matcher_of(channel: MapChannel, rule: Rule, *, reverse: bool = False) -> ChannelMatcher:
    """Return a matcher of a map's channel for a new stream.

    Args:
        channel: of the map.
        rule: how candidates are made.
        reverse: whether the route is driven the other way. Windows and steps then follow the places
            in reverse order.
    """
    metric = channel.metric
    matcher: ChannelMatcher
    if rule == "filter":
        matcher = FilterMatcher(*filter_model(channel, reverse=reverse))
    else:
        matcher = WindowMatcher(metric, channel.scales.tolist(), rule)
    return ReverseMatcher(matcher, len(metric.places)) if reverse else matcher


def filter_model(channel: MapChannel, *, reverse: bool) -> tuple[Array, Array, float]:
    """Return the steps, the jumps and the persistence of a channel, see ``PlaceFilter``."""
    metric = channel.metric
    steps = _reversed_steps(metric.steps) if reverse else metric.steps
    # A speed lasts about as long as a segment of the route.
    return steps, _jumps(metric), float(channel.scales.mean())


def candidate_of(place_filter: PlaceFilter) -> Candidate:
    """Return what a filter believes in; none before the first frame that was seen."""
    if not place_filter.begun:
        return NO_CANDIDATE
    best, places, beliefs = place_filter.believed(NEXT_TO_NOTHING)
    return Candidate(int(places[best]), float(beliefs[best]), places, beliefs)


def turned_back(turned: Candidate, last: int) -> Candidate:
    """Return a candidate in the order of the map that was made in reverse, up to this place."""
    if turned.place == UNANSWERED:
        return turned
    places, evidence = last - turned.places[::-1], turned.evidence[::-1].copy()
    return Candidate(last - turned.place, turned.score, places, evidence)


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


def _jumps(metric: MapMetric) -> Array:
    """How far places are from those half a map away."""
    count = len(metric.places)
    some = evenly_spaced(np.arange(count))
    here, there = metric.places[some], metric.places[some - count // 2]
    difference = here.astype(np.float32) - there
    return np.asarray(metric.unit * np.linalg.norm(difference, axis=1), np.float32)
