"""Fixed-lag smoothing: each frame's posterior given some later frames.

A frame is smoothed as soon as the vehicle's place is nearly certain, or that it was nowhere on the
map; at the latest after ``lag`` more frames. Frames are smoothed in order. The backward pass runs
once in a few frames, over the frames that still wait, at the places of their traces. It costs about
twice the filter's own pass, and less on a large map.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from placefield.matching.backward import (
    NOWHERE,
    BackwardMessage,
    BackwardPass,
    Posterior,
    posterior,
)
from placefield.matching.best_window import Vicinity, best_window
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.matching.motion import StepLengths
from placefield.matching.roads import LINE, Roads
from placefield.matching.trace import Trace

_EVERY = 3  # frames between two backward passes
_CERTAIN = 0.999  # at this probability, more frames change nothing
_HOPELESS, _PATIENCE = 0.001, 10  # at this probability, nothing changes after so many frames
_AT_ONCE = 5  # frames that are smoothed together when the oldest has waited ``lag`` frames


class SmoothedPosterior(NamedTuple):
    """The posterior of a frame given some later frames; the lag is their number."""

    lag: int
    posterior: Posterior


class Smoother:
    """Smooths one stream."""

    def __init__(
        self,
        lengths: StepLengths,
        lag: int,
        vicinity: Vicinity,
        roads: Roads = LINE,
    ) -> None:
        """Prepare for a new stream.

        Args:
            lengths: of steps on the whole map.
            lag: frames that a frame waits for at most, or ``WHOLE_DRIVE``.
            vicinity: within which a match is right.
            roads: of the whole map.
        """
        self._lag, self._vicinity = lag, vicinity
        self._backward = BackwardPass(lengths, roads)
        self._waiting: deque[Trace | None] = deque()
        self._frames = 0
        self._unobserved = 0  # in a row

    def grow(self, lengths: StepLengths, vicinity: Vicinity) -> None:
        """Append places to the map; see the arguments of the same names when it began."""
        self._backward.grow(lengths)
        self._vicinity = vicinity

    def update(self, trace: Trace | None) -> list[SmoothedPosterior]:
        """Add the next trace, None before the first observation; return the frames smoothed now."""
        self._waiting.append(trace)
        if self._lag == WHOLE_DRIVE:
            return []
        self._frames += 1
        is_news = trace is None or trace.observed
        self._unobserved = 0 if is_news else self._unobserved + 1
        oldest = len(self._waiting) - 1
        if oldest < self._lag and (self._frames % _EVERY or not is_news):
            return []
        return self._smooth(self._least_lag(oldest))

    def _least_lag(self, oldest: int) -> int:
        """Return the lag from which on a frame is smoothed though its place is not certain."""
        if oldest < self._lag:
            return self._lag + 1
        if self._unobserved >= self._lag:
            return 0  # the waiting frames were not observed, either
        return max(self._lag - _AT_ONCE + 1, 0)

    def finish(self) -> list[SmoothedPosterior]:
        """Smooth all frames: the stream is over."""
        posteriors = [_posterior(trace, message) for trace, message in self._back()]
        self._waiting.clear()
        return [SmoothedPosterior(lag, each) for lag, each in enumerate(posteriors)][::-1]

    def _smooth(self, enough: int) -> list[SmoothedPosterior]:
        newest = len(self._waiting) - 1
        smoothed = []
        for number, (trace, message) in enumerate(reversed([*self._back()])):
            posterior, lag = _posterior(trace, message), newest - number
            if not (self._is_certain(posterior, lag) or lag >= enough):
                break
            smoothed.append(SmoothedPosterior(lag, posterior))
            self._waiting.popleft()
        return smoothed

    def _is_certain(self, smoothed: Posterior, lag: int) -> bool:
        if not len(smoothed.places):
            return True
        places, belief, _ = smoothed
        probability = best_window(places, belief, self._vicinity)[1]
        return probability >= _CERTAIN or (probability <= _HOPELESS and lag >= _PATIENCE)

    def _back(self) -> Iterator[tuple[Trace, BackwardMessage] | tuple[None, None]]:
        """Yield each waiting frame, from the newest on, with its backward message."""
        later: Trace | None = None
        message: BackwardMessage | None = None
        for trace in reversed(self._waiting):
            if trace is None:
                yield None, None
                continue
            if later is None or message is None:
                message = self._backward.begin(trace)
            elif later is not trace:  # a repeated frame is no step of time
                message = self._backward.back(later, message, trace)
            yield trace, message
            later = trace


def _posterior(trace: Trace | None, message: BackwardMessage | None) -> Posterior:
    return NOWHERE if trace is None or message is None else posterior(trace, message)
