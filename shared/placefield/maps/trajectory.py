"""Where a vehicle was: between its poses, how far along them, and which way it looked."""

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

MAX_GAP_NS = 2_000_000_000
"""Between poses that are further apart in time than this, nobody knows the way."""

PoseAxes = Literal["x-forward", "z-forward"]
"""A vehicle's, with y on the left and z up (REP 103), or a camera's, with x right and y down."""

_STEP_M = 0.5  # a shorter one says little about the direction: positions jitter


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where a vehicle was at so many instants.

    Attributes:
        stamps: (N,) int64, nanoseconds, ascending, none twice; N is 1 or more.
        states: (N, 4) float64: x and y in metres, yaw in radians without its jumps of 2π, and
            metres travelled.
        reach_ns: how long before the first instant and after the last the vehicle was there too:
            half the usual time between two, for clocks are rounded and do not tick together.
    """

    stamps: NDArray[np.int64]
    states: NDArray[np.float64]
    reach_ns: int

    @classmethod
    def of(cls, stamps: NDArray[np.int64], poses: NDArray[np.float64]) -> Self:
        """Make one of poses (N, 3) in any order; of those with one stamp, the first counts."""
        ascending, first = np.unique(stamps, return_index=True)
        x, y, yaw = poses[first].T
        usual = np.median(np.diff(ascending)) if len(ascending) > 1 else 0
        return cls(
            ascending,
            np.column_stack([x, y, np.unwrap(yaw), travelled(poses[first])]),
            int(min(usual, MAX_GAP_NS) / 2),
        )

    def covers(self, stamp_ns: int) -> bool:
        """Return whether an instant is neither before the first nor after the last."""
        first, last = int(self.stamps[0]), int(self.stamps[-1])
        return first - self.reach_ns <= stamp_ns <= last + self.reach_ns

    def at(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return where the vehicle was at each of the stamps, (M,) int64.

        Between two instants it drives straight on, if they are at most ``MAX_GAP_NS`` apart.

        Returns:
            (M, 4) float64: x, y, yaw in -π … π, metres travelled; NaN where nobody knows.
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

    Poses that nobody knows, NaN, lie evenly on the straight way between those that are known;
    before the first of these and after the last, at the mean step. At least one is known.
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
    """Return the yaw of a vehicle that looks where it drives, (K,) radians from x to y.

    It is the direction from a position (K, 2) to a later one half a metre away or more; at the end
    it stays, and of a vehicle that never moves it is 0.
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
