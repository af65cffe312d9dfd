"""The filter's update where odometry tells the speed of every vehicle, in one compiled loop."""

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of
from placefield.matching.motion import Array


@kernel
def spread(
    belief: Array,
    carried: Array,
    steps: Array,
    driven: Array,
    found: Array,
    observed: Array,
    likelihood: Array,
    of_place: Array,
    of_speed: NDArray[np.float64],
) -> tuple[float, float]:
    """Spread what was carried on over the speeds that are driven, and update it by the frame.

    Args:
        belief: (2, S, K) float32, receives the beliefs after the frame.
        carried: (2, 2, K) float32, beliefs that stayed at a place and those that came to it.
        steps: (K,) float32, likelihood of the step by the place that it leads to.
        driven: (S,) float32, chance of each speed; most are 0.
        found: (2, S) float32, see ``Transition``.
        observed: (2, K) float32, see ``advance``.
        likelihood: (K,) float32, see there.
        of_place: (2, K) float32, receives the sums over the speeds.
        of_speed: (2, S) float64, receives the sums over the places.

    Returns:
        The sum of the beliefs on the map before the update, and that of each times its likelihood.
    """
    predicted = np.zeros(len(steps), np.float32)
    of_place[:] = 0
    for hypothesis in range(len(belief)):
        stays, comes, sums = carried[0, hypothesis], carried[1, hypothesis], of_place[hypothesis]
        for speed in range(len(driven)):
            after, chance = belief[hypothesis, speed], driven[speed]
            if chance == 0:
                after[:] = 0
                of_speed[hypothesis, speed] = 0
                continue
            anyone = found[hypothesis, speed]
            _update(chance, (stays, comes), steps, anyone, (observed[0], observed[1]), after)
            _add(after, sums)
            of_speed[hypothesis, speed] = sum_of(after)
            if hypothesis == 0:
                for i in range(len(predicted)):
                    predicted[i] += chance * (stays[i] + comes[i]) * steps[i] + anyone
    total = sum_of(predicted)
    for i in range(len(predicted)):
        predicted[i] *= likelihood[i]
    return total, sum_of(predicted)


@kernel
def _update(
    chance: float,
    carried: tuple[Array, Array],
    steps: Array,
    found: float,
    looks: tuple[Array, Array],
    after: Array,
) -> None:
    """Write the beliefs at one speed after the frame, of those that stayed and that came."""
    stays, comes = carried
    again, anew = looks
    for i in range(len(after)):
        moved = chance * steps[i]
        after[i] = moved * stays[i] * again[i] + (moved * comes[i] + found) * anew[i]


@kernel
def _add(values: Array, sums: Array) -> None:
    for i in range(len(sums)):
        sums[i] += values[i]
