"""The backward pass of the smoother: the likelihood of later frames given each state, back in time.

It runs on the places of the frames' traces.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.carrying import carry_back
from placefield.matching.motion import (
    FIND,
    HYPOTHESES,
    LOSE,
    SPEEDS,
    Array,
    StepLengths,
    step_likelihood,
)
from placefield.matching.odometry import Displacement, speeds_of
from placefield.matching.roads import LINE, Roads, RouteCells
from placefield.matching.smooth_kernel import step_back, weigh
from placefield.matching.trace import ObservedTransition, Trace

Vector = NDArray[np.float64]


class BackwardMessage(NamedTuple):
    """The likelihood of all later frames given each state at a frame, up to a factor.

    Attributes:
        placed: (n, 2, S) float32, at the places of the frame's trace.
        lost: (S,) float64, when lost.
    """

    placed: Array
    lost: Vector


class Posterior(NamedTuple):
    """The smoothed posterior of a frame.

    Attributes:
        places: (n,) int32, ascending; empty before the first observation.
        belief: (n,) float32, posterior of each; that of all other places is negligible.
        too_fast: posterior that the vehicle moved faster than the map resolves.
    """

    places: NDArray[np.int32]
    belief: Array
    too_fast: float


NOWHERE = Posterior(np.empty(0, np.int32), np.empty(0, np.float32), 0.0)


class BackwardPass:
    """Goes back over the frames of one stream."""

    def __init__(self, lengths: StepLengths, roads: Roads = LINE) -> None:
        """Prepare for a map.

        Args:
            lengths: of steps on the whole map.
            roads: of the whole map.
        """
        self._lengths, self._roads, chains = lengths, roads, roads.chains
        passages = chains.ahead, chains.behind
        self._passages = passages if any(len(each.source) for each in passages) else None

    def grow(self, lengths: StepLengths) -> None:
        """Replace the lengths of steps: the map has more places."""
        self._lengths = lengths

    def begin(self, trace: Trace) -> BackwardMessage:
        """Return the message of the newest frame: no frames follow it."""
        return BackwardMessage(np.ones_like(trace.belief), np.ones(len(SPEEDS)))

    def back(self, later: Trace, message: BackwardMessage, trace: Trace) -> BackwardMessage:
        """Go back from a frame to the one before it, and return the message of the latter."""
        cells = self._roads.cells
        if cells is not None and later.displacement is not None:
            return self._back_by_odometry(later.displacement, cells, later.transit, message, trace)
        placed, lost = step_back(
            later.transit,
            message.placed,
            message.lost,
            self._lengths.apart,
            self._lengths.stationary,
            self._roads.chains.edges,
            self._passages,
            trace.places,
        )
        return BackwardMessage(placed, lost)

    def _back_by_odometry(
        self,
        displacement: Displacement,
        cells: RouteCells,
        later: ObservedTransition,
        message: BackwardMessage,
        trace: Trace,
    ) -> BackwardMessage:
        """Go back by a displacement from odometry, whatever the speed before it was."""
        pace = displacement.pace / cells.spacing
        speeds = speeds_of(pace)
        there = later.observed[:, :, None] * (message.placed @ speeds).astype(np.float32)
        found = float((there[1] @ HYPOTHESES).sum()) / later.all_places
        when_lost = float(message.lost @ speeds)
        from_lost = float(later.lost_likelihood[0]) * ((1 - FIND) * when_lost + FIND * found)
        apart = np.ascontiguousarray(self._lengths.apart[:, later.places])
        steps = np.empty(len(later.places), np.float32)
        step_likelihood(apart, 0, self._lengths.stationary, pace, later.step, steps)
        there *= steps[:, None]
        carried = carry_back(later.places, there, self._roads, displacement, trace.places)
        before = (1 - LOSE) * carried + LOSE * later.jump * when_lost
        top = max(float(before.max()), from_lost)
        every = np.repeat((before / top).astype(np.float32)[:, :, None], len(SPEEDS), axis=2)
        return BackwardMessage(every, np.full(len(SPEEDS), from_lost / top))


def posterior(trace: Trace, message: BackwardMessage) -> Posterior:
    """Return the smoothed posterior of a frame, given its backward message."""
    smoothed = weigh(trace.places, trace.belief, message.placed, trace.lost, message.lost)
    return Posterior(*smoothed)
