"""A check for steps between poses that no vehicle can make."""

import numpy as np
from numpy.typing import NDArray

FASTEST = 100.0
"""The highest plausible speed of a vehicle, metres per second."""

_FAR_M = 10_000.0  # an implausible step, however long it took
_UNUSUAL = 10  # times the median step: jitter within milliseconds is not reported


def implausible_steps(poses: NDArray[np.float64], stamps: NDArray[np.int64] | None) -> str | None:
    """Describe implausible steps between poses in one line; None if there are none.

    A step is implausible if it is more than ten times the median step, and either faster than
    ``FASTEST`` or longer than 10 km.

    Args:
        poses: (K, 2 or more) x, y, …, metres; NaN where unknown.
        stamps: (K,) nanoseconds; None if unknown.
    """
    known = np.flatnonzero(np.isfinite(poses[:, 0]))
    if len(known) < 2:
        return None
    steps = np.linalg.norm(np.diff(poses[known, :2], axis=0), axis=1)
    moved = steps[steps > 0]
    usual = float(np.median(moved)) if len(moved) > 2 else 0.0
    implausible = steps > _FAR_M
    if stamps is not None:
        seconds = np.diff(stamps[known]) / 1e9
        implausible |= (steps > FASTEST * seconds) & (steps > FASTEST / 10)
    jumps = np.flatnonzero(implausible & (steps > _UNUSUAL * usual))
    if not len(jumps):
        return None
    worst = int(jumps[np.argmax(steps[jumps])])
    return (
        f"{len(jumps)} of {len(steps)} steps between poses are too long for a vehicle; the longest "
        f"is from frame {known[worst]} to {known[worst + 1]}, {steps[worst] / 1000:.3g} km; check "
        "that all frames are of one drive"
    )
