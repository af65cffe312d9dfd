"""The trajectory of a vehicle: interpolated poses, metres travelled, and headings."""

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

MAX_GAP_NS = 2_000_000_000
"""Poses are not interpolated over a longer gap than this."""

PoseAxes = Literal["x-forward", "z-forward"]
"""The vehicle's axes, y left and z up (REP 103), or a camera's, x right and y down."""

_STEP_M = 0.5  # a shorter step gives no reliable heading, because positions jitter


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The states of a vehicle at N instants.

    Attributes:
        stamps: (N,) int64, nanoseconds, strictly ascending; N is 1 or more.
        states: (N, 4) float64: x and y in metres, yaw in radians (unwrapped), metres travelled.
        reach_ns: tolerance before the first and after the last instant: half the median interval,
            because clocks are rounded and not synchronous.
    """

    stamps: NDArray[np.int64]
    states: NDArray[np.float64]
    reach_ns: int

    @classmethod
    def of(cls, stamps: NDArray[np.int64], poses: NDArray[np.float64]) -> Self:
        """Return the trajectory of poses (N, 3) in any order; the first pose of a stamp counts."""
        ascending, first = np.unique(stamps, return_index=True)
        x, y, yaw = poses[first].T
        usual = np.median(np.diff(ascending)) if len(ascending) > 1 else 0
        return cls(
            ascending,
            np.column_stack([x, y, np.unwrap(yaw), travelled(poses[first])]),
            int(min(usual, MAX_GAP_NS) / 2),
        )

    def covers(self, stamp_ns: int) -> bool:
        """Return whether an instant, nanoseconds, lies between the first and the last."""
        first, last = int(self.stamps[0]), int(self.stamps[-1])
        return first - self.reach_ns <= stamp_ns <= last + self.reach_ns

    def at(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the state of the vehicle at each of the stamps, (M,) int64.

        States are interpolated between two instants that are at most ``MAX_GAP_NS`` apart.

        Returns:
            (M, 4) float64: x, y, yaw in -π … π, metres travelled; NaN where unknown.
        """
        last = len(self.stamps) - 1
        after = np.searchsorted(self.stamps, stamps).clip(max=last)
        alone = (self.stamps[after] <= stamps) | (after == 0)  # at an instant, or outside of all
        before = np.where(alone, after, after - 1)
        gap = self.stamps[after] - self.stamps[before]
        share = np.where(alone, 0, stamps - self.stamps[before]) / np.maximum(gap, 1)
        states = self.states[before]
        states += share[:, np.newaxis] * (self.states[after] - states)
        states[:, 2] = np.arctan2(np.sin(states[:, 2]), np.cos(states[:, 2]))
        outside = np.maximum(self.stamps[0] - stamps, stamps - self.stamps[-1])
        states[(gap > MAX_GAP_NS) | (outside > self.reach_ns)] = np.nan
        return states


def travelled(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the metres travelled up to each pose, (K,), of poses (K, 2 or more) from x and y.

    Unknown poses, NaN, are taken to lie evenly on the line between known ones; before the first
    known pose and after the last, the mean step is used. At least one pose is known.
    """
    known = np.flatnonzero(np.isfinite(poses[:, 0]))
    steps = np.linalg.norm(np.diff(poses[known, :2], axis=0), axis=1)
    metres = np.concatenate([[0.0], np.cumsum(steps)])
    if len(known) == len(poses):
        return metres
    frames = np.arange(len(poses))
    mean_step = metres[-1] / max(known[-1] - known[0], 1)
    outside = np.minimum(frames - known[0], 0) + np.maximum(frames - known[-1], 0)
    filled = np.interp(frames, known, metres) + mean_step * outside
    return np.asarray(np.maximum.accumulate(filled - filled[0]))


def directions(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the yaw of a vehicle that looks in its direction of travel, (K,) radians from x to y.

    The yaw is the direction from a position (K, 2) to the next one at least half a metre away. At
    the end the last yaw stays. The yaw of a vehicle that never moves is 0.
    """
    yaws = np.zeros(len(positions))
    later, yaw = 0, 0.0
    for at, position in enumerate(positions):
        while later < len(positions) and np.hypot(*(positions[later] - position)) < _STEP_M:
            later += 1
        if later < len(positions):
            yaw = np.arctan2(*(positions[later] - position)[::-1])
        yaws[at] = yaw
    return yaws
