"""Recognises the places of one drive among its own earlier ones, without a reference.

A frame becomes a place of a map that grows, and the rule ``filter`` matches each frame with that
map. Neighbouring frames look alike, so a place joins the map only once the view has changed by
``SPAN`` average steps. For the filter, a vehicle at a new place is lost. A frame of a vehicle that
stands is no place, and no step of time.
"""

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.features.local_descriptors import SPAN, LocalDescriptor, LocalDescriptors
from placefield.matching.best_window import Vicinity, best_window
from placefield.matching.candidate import TOO_FAST, UNANSWERED, Candidate
from placefield.matching.filter_matcher import UNMAPPED, FilterMatcher, WholeMap
from placefield.matching.growing_places import GrowingPlaces, compare, lengths_of
from placefield.matching.matcher import SmoothedCandidate
from placefield.matching.smoother import Smoother

_CERTAIN = 0.999  # at this probability, a place is taken for the same as an earlier one

Array = NDArray[np.float32]


class Answer(NamedTuple):
    """Whether a frame shows an earlier place of the drive.

    Attributes:
        place: number of the earlier frame that it most likely shows; ``UNANSWERED`` if none.
        probability: that it shows that frame's place, within the tolerance.
        new: probability that it shows no earlier place.
        known: whether it is a loop: ``probability`` is at least ``matching.precision``, and the
            vehicle is not too fast.
        too_fast: posterior that the vehicle moves faster than its earlier frames resolve.
    """

    place: int
    probability: float
    new: float
    known: bool
    too_fast: float = 0.0


class SmoothedAnswer(NamedTuple):
    """The smoothed answer of a frame, by its number; it uses ``lag`` later frames."""

    frame: int
    lag: int
    answer: Answer


NEW = Answer(UNANSWERED, 0.0, 1.0, False)
"""The frame has no earlier place to be compared with."""


def is_loop(probability: float, too_fast: float, config: MatchingConfig) -> bool:
    """Return whether an answer of this probability is known, see ``Answer``."""
    return probability >= config.precision and too_fast < TOO_FAST


class Explorer:
    """Finds the loops of one drive, frame by frame; an answer depends on no later frame.

    A smoothed answer follows, which depends on ``matching.lag`` later frames at most. Time per
    frame, and memory, are linear in the number of places so far.
    """

    def __init__(self, config: MatchingConfig) -> None:
        """Begin a drive. Of the settings, tolerance, precision and lag count."""
        self._config = config
        self._descriptors = LocalDescriptors()
        self._places: GrowingPlaces | None = None
        self._matcher: FilterMatcher | None = None
        self._frame_of: list[int] = []  # the number of each place's frame
        self._travelled: list[float] = []  # up to each place, see ``LocalDescriptor``
        self._same = np.empty(0, np.int32)  # which place each is the same as
        self._has_twins = False
        self._mapped = 0  # so many of the places, the first ones, are in the map
        self._smoothed: list[SmoothedAnswer] = []
        self._waiting: deque[int] = deque()  # numbers of the frames that are not smoothed yet

    @property
    def frames(self) -> int:
        """Number of frames so far, skipped ones included."""
        return self._descriptors.frames

    def skip(self, frames: int) -> None:
        """Count frames that nobody observed, and do not answer them.

        For the filter they take no time. A few of them are better given to ``update`` as None.
        """
        self._descriptors.frames += frames

    def update(self, raw: Array | None) -> Answer:
        """Answer for the next frame by its raw feature (D,) float32; None: it was not observed.

        Raises:
            FrameError: the feature has another shape than those before, or is not finite; the frame
                does not count.
        """
        described = self._descriptors.update(raw)
        self._waiting.append(self.frames - 1)
        for first in described[:-1]:
            self._add(first)
        frame = described[-1] if described else None
        if frame is not None:
            self._extend(frame.travelled)
        answer = self._match(frame)
        if frame is not None:
            self._add(frame)
            if answer.probability >= _CERTAIN:
                self._join(frame.frame, answer)
        return answer

    def smoothed(self) -> list[SmoothedAnswer]:
        """Return the smoothed answers that are new since the last call.

        Every answered frame has one, in order, at most ``matching.lag`` frames later, or when the
        drive is finished.
        """
        new, self._smoothed = self._smoothed, []
        return new

    def finish(self) -> list[SmoothedAnswer]:
        """Return the remaining smoothed answers: the drive is over."""
        if self._matcher is not None:
            self._smooth(self._matcher.finish())
        return self.smoothed()

    def _match(self, frame: LocalDescriptor | None) -> Answer:
        if self._matcher is None:
            self._smoothed.append(SmoothedAnswer(self._waiting.popleft(), 0, NEW))
            return NEW
        self._matcher.local(None if frame is None else compare(self._metric, frame.vector))
        candidate = self._matcher.reduce(())
        self._smooth(self._matcher.smoothed())
        return self._answer(candidate)

    def _add(self, frame: LocalDescriptor) -> None:
        """Make a place of a frame, if the vehicle has moved since the last one."""
        if self._travelled and frame.travelled == self._travelled[-1]:
            return
        if self._places is None:
            self._places = GrowingPlaces(len(frame.vector))
        self._same = np.append(self._same, np.int32(self._places.count))
        self._places.add(frame.vector)
        self._frame_of.append(frame.frame)
        self._travelled.append(frame.travelled)

    def _extend(self, travelled: float) -> None:
        """Let the places join the map that are no neighbours of the vehicle any more."""
        count = bisect_right(self._travelled, travelled - SPAN)
        if self._places is None or count == self._mapped:
            return
        self._mapped = count
        self._metric = self._places.first(count)
        lengths, vicinity = lengths_of(self._metric), self._vicinity()
        if self._matcher is None:
            smoother = Smoother(lengths, self._config.lag, vicinity)
            whole = WholeMap(lengths, None, None, unmapped=UNMAPPED)
            self._matcher = FilterMatcher(whole, slice(0, count), 0, [smoother])
        else:
            self._matcher.grow(lengths, vicinity)

    def _vicinity(self) -> Vicinity:
        """Return what is near a place of the map so far."""
        same = self._same[: self._mapped] if self._has_twins else None
        return Vicinity(self._config.tolerance, same)

    def _smooth(self, candidates: Sequence[SmoothedCandidate]) -> None:
        for smoothed in candidates:
            frame, answer = self._waiting.popleft(), self._answer(smoothed.candidate)
            self._join(frame, answer)
            self._smoothed.append(SmoothedAnswer(frame, smoothed.lag, answer))

    def _answer(self, candidate: Candidate) -> Answer:
        if not len(candidate.places):
            return NEW
        place, probability = best_window(candidate.places, candidate.evidence, self._vicinity())
        new = max(float(np.float32(1) - candidate.evidence.sum()), 0.0)  # exact as float32, too
        known = is_loop(probability, candidate.too_fast, self._config)
        frame = self._frame_of[place]
        return Answer(frame, min(probability, 1.0), new, known, candidate.too_fast)

    def _join(self, frame: int, answer: Answer) -> None:
        """Let a frame's place be the same as an earlier one, or its own, as the answer says.

        So the belief of a third lap is not divided between the first and the second.
        """
        place = bisect_left(self._frame_of, frame)
        if place == len(self._frame_of) or self._frame_of[place] != frame:
            return
        twin = place
        if answer.probability >= _CERTAIN:
            twin = int(self._same[bisect_left(self._frame_of, answer.place)])
            self._has_twins = True
        if self._same[place] != twin:
            self._same = self._same.copy()  # the smoother keeps those of the last place
            self._same[place] = twin
