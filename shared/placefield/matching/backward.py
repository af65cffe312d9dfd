"""The backward pass: how likely what follows is from each state, frame by frame back.

It runs on the places that were believed in when the frames came.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    SPEEDS,
    Array,
    StepLengths,
    motion,
    step_likelihood,
)
from placefield.matching.odometry import Road, Way, carry_back, speeds_of
from placefield.matching.smooth_kernel import step_back, weigh
from placefield.matching.trace import NEGLIGIBLE, Trace, Transit

Vector = NDArray[np.float64]


class Ahead(NamedTuple):
    """How likely what follows a frame is, from each state at it, in a unit of its own.

    Attributes:
        placed: (n, 2, S) float32, from the places of its trace.
        lost: (S,) float64, from being lost.
    """

    placed: Array
    lost: Vector


class Posterior(NamedTuple):
    """Where the vehicle was at a frame.

    Attributes:
        places: (n,) int32, ascending; empty before the first observation.
        belief: (n,) float32, posterior of each; the others' are negligible.
        too_fast: posterior that it moved faster than the map resolves.
    """

    places: NDArray[np.int32]
    belief: Array
    too_fast: float


NOWHERE = Posterior(np.empty(0, np.int32), np.empty(0, np.float32), 0.0)


class BackwardPass:
    """Goes back over the frames of one stream."""

    def __init__(self, lengths: StepLengths, road: Road | None) -> None:
        """Prepare for a map.

        Args:
            lengths: of steps on the whole map.
            road: the way along it; None if its metres are not known.
        """
        self._lengths, self._road, self._motion = lengths, road, motion()

    def begin(self, trace: Trace) -> Ahead:
        """Return what follows the newest frame: nothing yet."""
        return Ahead(np.ones_like(trace.belief), np.ones(len(SPEEDS)))

    def back(self, later: Trace, ahead: Ahead, trace: Trace) -> Ahead:
        """Go back from a frame, of which what follows is known, to the one before it."""
        if self._road is not None and later.way is not None:
            return self._back_by(later.way, self._road, later.transit, ahead, trace)
        before = np.empty_like(trace.belief)
        lost = step_back(
            later.transit,
            ahead.placed,
            ahead.lost,
            self._lengths.apart,
            self._lengths.standing,
            self._motion,
            trace.places,
            before,
        )
        return Ahead(before, lost)

    def _back_by(self, way: Way, road: Road, later: Transit, ahead: Ahead, trace: Trace) -> Ahead:
        """Go back over a way that odometry tells, whatever the speed before it was."""
        pace = way.pace / road.spacing
        speeds = speeds_of(pace)
        there = later.observed[:, :, None] * (ahead.placed @ speeds).astype(np.float32)
        found = float((there[1] @ HYPOTHESES).sum()) / self._lengths.apart.shape[1]
        when_lost = float(ahead.lost @ speeds)
        from_lost = float(later.lost_likelihood[0]) * ((1 - FIND) * when_lost + FIND * found)
        apart = np.ascontiguousarray(self._lengths.apart[:, later.places])
        steps = np.empty(len(later.places), np.float32)
        step_likelihood(apart, 0, self._lengths.standing, pace, later.step, steps)
        there *= steps[:, None]
        carried = np.empty((len(trace.places), 2), np.float32)
        carry_back(later.places, there, road, way, trace.places, carried)
        before = (1 - LOSE) * carried + LOSE * later.jump * when_lost
        top = max(float(before.max()), from_lost)
        every = np.repeat((before / top).astype(np.float32)[:, :, None], len(SPEEDS), axis=2)
        return Ahead(every, np.full(len(SPEEDS), from_lost / top))


def posterior(trace: Trace, ahead: Ahead) -> Posterior:
    """Return where the vehicle was at a frame, given what followed."""
    belief = np.empty(len(trace.places), np.float32)
    too_fast = weigh(trace.belief, ahead.placed, trace.lost, ahead.lost, belief)
    kept = np.flatnonzero(belief >= min(np.float32(NEGLIGIBLE), belief.max()))
    return Posterior(trace.places[kept], belief[kept], too_fast)
