"""The filter's update where odometry gives the vehicle's speed, in one compiled loop."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.motion import Array


class OdometryTransition(NamedTuple):
    """The transition from one frame to the next by odometry.

    Attributes:
        pace: places per frame.
        speeds: (S,) float32, chance of each speed.
        found: (2, S) float32, see ``Transition``.
    """

    pace: float
    speeds: Array
    found: Array


@kernel
def spread(
    belief: Array,
    carried: Array,
    steps: Array,
    speeds: Array,
    found: Array,
    ratios: Array,
    full_ratio: Array,
    by_place: Array,
    by_speed: NDArray[np.float64],
) -> tuple[float, float]:
    """Spread the carried beliefs over the speeds that the odometry allows, and update them.

    Args:
        belief: (2, S, K) float32, receives the beliefs after the frame.
        carried: (2, 2, K) float32, beliefs that stayed at a place and those that came to it.
        steps: (K,) float32, likelihood of the step by the place that it leads to.
        speeds: (S,) float32, chance of each speed; most are 0.
        found: (2, S) float32, see ``Transition``.
        ratios: (2, K) float32, see ``advance``.
        full_ratio: (K,) float32, see ``advance``.
        by_place: (2, K) float32, receives the sums over the speeds.
        by_speed: (2, S) float64, receives the sums over the places.

    Returns:
        The sum of the beliefs on the map before the update, and the sum of each times its
        ``full_ratio``.
    """
    predicted = np.zeros(len(steps), np.float32)
    by_place[:] = 0
    for hypothesis in range(len(belief)):
        stays, comes, sums = carried[0, hypothesis], carried[1, hypothesis], by_place[hypothesis]
        for speed in range(len(speeds)):
            after, chance = belief[hypothesis, speed], speeds[speed]
            if chance == 0:
                after[:] = 0
                by_speed[hypothesis, speed] = 0
                continue
            anyone = found[hypothesis, speed]
            _update(chance, (stays, comes), steps, anyone, (ratios[0], ratios[1]), after)
            _add(after, sums)
            by_speed[hypothesis, speed] = sum_of(after)
            if hypothesis == 0:
                for i in range(len(predicted)):
                    predicted[i] += chance * (stays[i] + comes[i]) * steps[i] + anyone
    total = sum_of(predicted)
    for i in range(len(predicted)):
        predicted[i] *= full_ratio[i]
    return total, sum_of(predicted)


@kernel
def _update(
    chance: float,
    carried: tuple[Array, Array],
    steps: Array,
    found: float,
    ratios: tuple[Array, Array],
    after: Array,
) -> None:
    """Write the beliefs at one speed after the frame, of vehicles that stayed and that came."""
    stays, comes = carried
    again, anew = ratios
    for i in range(len(after)):
        moved = chance * steps[i]
        after[i] = moved * stays[i] * again[i] + (moved * comes[i] + found) * anew[i]


@kernel
def _add(values: Array, sums: Array) -> None:
    for i in range(len(sums)):
        sums[i] += values[i]
