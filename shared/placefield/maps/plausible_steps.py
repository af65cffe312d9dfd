"""Positions that no vehicle can have come to from the ones before."""

import numpy as np
from numpy.typing import NDArray

FASTEST = 100.0
"""Metres per second: no vehicle that looks at places is faster."""

_FAR_M = 10_000.0  # in one step, whenever that was
_UNUSUAL = 10  # times the usual step: of a jitter within milliseconds nobody has to hear


def implausible_steps(poses: NDArray[np.float64], stamps: NDArray[np.int64] | None) -> str | None:
    """Say where poses jump as no vehicle does; None where they do not.

    That is a step of more than ten times the usual one which is faster than ``FASTEST``, or longer
    than 10 km.

    Args:
        poses: (K, 2 or more) from x and y, metres; NaN where nobody knows.
        stamps: (K,) of them, nanoseconds; None where nobody knows.
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
        f"the poses jump as no vehicle does, in {len(jumps)} of {len(steps)} steps, most from "
        f"frame {known[worst]} to {known[worst + 1]}, by {steps[worst] / 1000:.3g} km; are they of "
        "one drive?"
    )
