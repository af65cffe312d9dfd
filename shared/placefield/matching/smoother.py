"""Fixed-lag smoothing: each frame's posterior given some frames after it, settled when it is sure.

A frame is settled when it is all but certain where it was, or that it is nowhere, or when it has
waited for ``lag`` frames. Frames are settled in order. The backward pass runs over the frames that
are not settled, once in a few frames, and on the places that were believed in when they came: so it
costs about twice the filter's own pass, and less on a large map.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.best_window import best_window
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    SPEEDS,
    StepLengths,
    motion,
    step_likelihoods,
)
from placefield.matching.odometry import Road, Way, carry_back, speeds_of
from placefield.matching.smooth_kernel import step_back
from placefield.matching.trace import NEGLIGIBLE, Trace

Array = NDArray[np.float32]
Vector = NDArray[np.float64]

_EVERY = 3  # frames
_CERTAIN = 0.999  # more frames change nothing
_HOPELESS, _PATIENCE = 0.001, 10  # likewise, after so many
_AT_ONCE = 5  # frames that are settled together, when the first of them has waited for long enough


class Smoothed(NamedTuple):
    """A frame's posterior given frames after it.

    Attributes:
        lag: how many.
        places: (n,) int32, ascending; empty before the first observation.
        belief: (n,) float32, posterior of each; the others' are negligible.
    """

    lag: int
    places: NDArray[np.int32]
    belief: Array


class Smoother:
    """Smooths one stream."""

    def __init__(
        self, lengths: StepLengths, lag: int, tolerance: int, road: Road | None = None
    ) -> None:
        """Prepare for a new stream.

        Args:
            lengths: of steps on the whole map.
            lag: frames that a frame waits for at most, or ``WHOLE_DRIVE``.
            tolerance: places within which a match is right.
            road: the way along the whole map; None if its metres are not known.
        """
        self._lengths, self._lag, self._tolerance = lengths, lag, tolerance
        self._road = road
        self._motion = motion()
        self._rows = np.full(lengths.apart.shape[1], -1, np.int32)
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
        return self._settle(0)

    def _settle(self, enough: int) -> list[Smoothed]:
        newest = len(self._waiting) - 1
        settled = []
        for number, (places, belief) in enumerate(self._smooth()):
            lag = newest - number
            probability = best_window(places, belief, self._tolerance)[1] if len(places) else 1.0
            certain = probability >= _CERTAIN or (probability <= _HOPELESS and lag >= _PATIENCE)
            if not (certain or lag >= enough):
                break
            settled.append(Smoothed(lag, places, belief))
            self._waiting.popleft()
        return settled

    def _smooth(self) -> list[tuple[NDArray[np.int32], Array]]:
        """Return places and posterior of each frame that waits, given all of them."""
        smoothed = []
        later: Trace | None = None
        backward, backward_lost = np.empty(0, np.float32), np.ones(len(SPEEDS))
        for trace in reversed(self._waiting):
            if trace is None:
                smoothed.append((np.empty(0, np.int32), np.empty(0, np.float32)))
                continue
            if later is None:
                backward = np.ones_like(trace.belief)
            elif later is not trace:  # a repeated frame is no step of time
                backward, backward_lost = self._back(later, trace, backward, backward_lost)
            smoothed.append(_posterior(trace, backward, backward_lost))
            later = trace
        return smoothed[::-1]

    def _back(
        self, later: Trace, trace: Trace, backward: Array, backward_lost: Vector
    ) -> tuple[Array, Vector]:
        seen = np.exp(later.counts[:, None] * later.evidence)
        if self._road is not None and later.way is not None:
            return self._back_by(
                self._road,
                later.way,
                later,
                trace,
                seen[:, :, None, None] * backward,
                backward_lost,
            )
        before = np.empty_like(trace.belief)
        lost = step_back(
            later.places,
            backward.copy(),
            seen,
            self._steps(later, SPEEDS),
            later.prior,
            self._motion,
            (backward_lost, later.stray, later.jump),
            trace.places,
            self._rows,
            before,
        )
        return before, lost

    def _steps(self, later: Trace, speeds: Vector) -> Array:
        """Likelihoods of the step to a frame at these speeds, (S, n), by the place it leads to."""
        steps = np.empty((len(speeds), len(later.places)), np.float32)
        apart = np.ascontiguousarray(self._lengths.apart[:, later.places])
        step_likelihoods(apart, self._lengths.standing, speeds, later.step, steps)
        return steps

    def _back_by(
        self, road: Road, way: Way, later: Trace, trace: Trace, seen: Array, lost: Vector
    ) -> tuple[Array, Vector]:
        """Go back over a way that odometry tells, whatever the speed before it was."""
        speeds = speeds_of(way.pace / road.spacing)
        ahead = (seen @ speeds).astype(np.float32)
        found = float((ahead[1] @ HYPOTHESES).sum()) / len(self._rows)
        when_lost = float(lost @ speeds)
        from_lost = float(later.stray[0]) * ((1 - FIND) * when_lost + FIND * found)
        ahead *= self._steps(later, np.array([way.pace / road.spacing])).T
        carried = np.empty((len(trace.places), 2), np.float32)
        carry_back(later.places, ahead, road, way, trace.places, carried)
        before = (1 - LOSE) * carried + LOSE * later.jump * when_lost
        top = max(float(before.max()), from_lost)
        every = np.repeat((before / top).astype(np.float32)[:, :, None], len(SPEEDS), axis=2)
        return every, np.full(len(SPEEDS), from_lost / top)


def _posterior(
    trace: Trace, backward: Array, backward_lost: Vector
) -> tuple[NDArray[np.int32], Array]:
    both = trace.belief * backward
    total = float(both.sum(dtype=np.float64)) + float(trace.lost @ backward_lost)
    belief = both[:, 0, :-1].sum(axis=1) / np.float32(total)  # at speeds that the map resolves
    kept = belief >= min(np.float32(NEGLIGIBLE), belief.max())
    return trace.places[kept], belief[kept]
