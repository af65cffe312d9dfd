"""Fixed-lag smoothing: each frame's posterior given some frames after it, smoothed when it is sure.

A frame is smoothed as soon as it is nearly certain where the vehicle was, or that it was nowhere on
the map; at the latest after ``lag`` more frames. Frames are smoothed in order. The backward pass
runs once in a few frames, over the frames that are still waiting, and on the places that had belief
when these came: it costs about twice the filter's own pass, and less on a large map.
"""

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.backward import NOWHERE, Ahead, BackwardPass, Posterior, posterior
from placefield.matching.best_window import best_window
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.matching.motion import StepLengths
from placefield.matching.odometry import Road
from placefield.matching.trace import Trace

_EVERY = 3  # frames
_CERTAIN = 0.999  # more frames change nothing
_HOPELESS, _PATIENCE = 0.001, 10  # likewise, after so many
_AT_ONCE = 5  # frames that are smoothed together, when the first of them has waited for long enough


class SmoothedPosterior(NamedTuple):
    """Where the vehicle was at a frame, given some frames after it: how many is the lag."""

    lag: int
    posterior: Posterior


class Smoother:
    """Smooths one stream."""

    def __init__(
        self,
        lengths: StepLengths,
        lag: int,
        tolerance: int,
        road: Road | None = None,
        same: NDArray[np.int32] | None = None,
    ) -> None:
        """Prepare for a new stream.

        Args:
            lengths: of steps on the whole map.
            lag: frames that a frame waits for at most, or ``WHOLE_DRIVE``.
            tolerance: places within which a match is right.
            road: the way along the whole map; None if its metres are not known.
            same: (K,) int32, which place of the map each is the same as; None: all differ.
        """
        self._lag, self._tolerance, self._same = lag, tolerance, same
        self._backward = BackwardPass(lengths, road)
        self._waiting: deque[Trace | None] = deque()
        self._frames = 0
        self._unobserved = 0  # in a row

    def update(self, trace: Trace | None) -> list[SmoothedPosterior]:
        """Take the next trace, None before the first observation; return what is smoothed now."""
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
        """Return after how many frames who is not certain yet has waited for long enough."""
        if oldest < self._lag:
            return self._lag + 1
        if self._unobserved >= self._lag:
            return 0  # those that wait were not observed, either
        return max(self._lag - _AT_ONCE + 1, 0)

    def finish(self) -> list[SmoothedPosterior]:
        """Smooth all frames: the stream is over."""
        posteriors = [_posterior(trace, ahead) for trace, ahead in self._back()]
        self._waiting.clear()
        return [SmoothedPosterior(lag, each) for lag, each in enumerate(posteriors)][::-1]

    def _smooth(self, enough: int) -> list[SmoothedPosterior]:
        newest = len(self._waiting) - 1
        smoothed = []
        for number, (trace, ahead) in enumerate(reversed([*self._back()])):
            posterior, lag = _posterior(trace, ahead), newest - number
            if not (self._is_certain(posterior, lag) or lag >= enough):
                break
            smoothed.append(SmoothedPosterior(lag, posterior))
            self._waiting.popleft()
        return smoothed

    def _is_certain(self, smoothed: Posterior, lag: int) -> bool:
        if not len(smoothed.places):
            return True
        places, belief, _ = smoothed
        probability = best_window(places, belief, self._tolerance, self._same)[1]
        return probability >= _CERTAIN or (probability <= _HOPELESS and lag >= _PATIENCE)

    def _back(self) -> Iterator[tuple[Trace, Ahead] | tuple[None, None]]:
        """Yield each frame that waits, from the newest on, and what follows it."""
        later: Trace | None = None
        ahead: Ahead | None = None
        for trace in reversed(self._waiting):
            if trace is None:
                yield None, None
                continue
            if later is None or ahead is None:
                ahead = self._backward.begin(trace)
            elif later is not trace:  # a repeated frame is no step of time
                ahead = self._backward.back(later, ahead, trace)
            yield trace, ahead
            later = trace


def _posterior(trace: Trace | None, ahead: Ahead | None) -> Posterior:
    return NOWHERE if trace is None or ahead is None else posterior(trace, ahead)
