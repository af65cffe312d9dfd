"""Fixed-lag smoothing: each frame's posterior given some frames after it, settled when it is sure.

A frame is settled when it is all but certain where it was, or that it is nowhere, or when it has
waited for ``lag`` frames. Frames are settled in order. The backward pass runs over the frames that
are not settled, once in a few frames, and on the places that were believed in when they came: so it
costs about twice the filter's own pass, and less on a large map.
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
_AT_ONCE = 5  # frames that are settled together, when the first of them has waited for long enough


class Smoothed(NamedTuple):
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

    def push(self, trace: Trace | None) -> list[Smoothed]:
        """Take the next frame's trace, None before the first observation; return who is settled."""
        self._waiting.append(trace)
        if self._lag == WHOLE_DRIVE:
            return []
        self._frames += 1
        is_news = trace is None or trace.observed
        self._unobserved = 0 if is_news else self._unobserved + 1
        oldest = len(self._waiting) - 1
        if oldest < self._lag and (self._frames % _EVERY or not is_news):
            return []
        return self._settle(self._least_lag(oldest))

    def _least_lag(self, oldest: int) -> int:
        """Return after how many frames who is not certain yet has waited for long enough."""
        if oldest < self._lag:
            return self._lag + 1
        if self._unobserved >= self._lag:
            return 0  # those that wait were not observed, either
        return max(self._lag - _AT_ONCE + 1, 0)

    def finish(self) -> list[Smoothed]:
        """Settle all frames: the stream is over."""
        smoothed = [_posterior(trace, ahead) for trace, ahead in self._back()]
        self._waiting.clear()
        return [Smoothed(lag, each) for lag, each in enumerate(smoothed)][::-1]

    def _settle(self, enough: int) -> list[Smoothed]:
        newest = len(self._waiting) - 1
        settled = []
        for number, (trace, ahead) in enumerate(reversed([*self._back()])):
            smoothed, lag = _posterior(trace, ahead), newest - number
            if not (self._is_certain(smoothed, lag) or lag >= enough):
                break
            settled.append(Smoothed(lag, smoothed))
            self._waiting.popleft()
        return settled

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
