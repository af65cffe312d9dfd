"""How a vehicle moves along the places of a map: the motion model of the rule ``filter``.

A vehicle moves at one of several speeds, from stationary to six places per frame, and keeps it for
a while. Its speed determines how long its steps are in descriptor space: a frame is expected to be
as far from the last one as the places are from each other that the vehicle passes in that time.
Below one place per frame that distance grows with the square root of the speed, as in a random
walk.
"""

import math
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of

Array = NDArray[np.float32]
Rows = TypeVar("Rows", bound=NDArray[np.generic])

_RESOLVED = [0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 0.5, 0.75, 1, 1.25, 1.5, 2, 3, 4, 5, 6]
_TOO_FAST = [7, 9, 11]
SPEEDS = np.array(_RESOLVED + _TOO_FAST)
"""Places per frame.

The last three stand for speeds that the map does not resolve: at those the place is not known.
Without them, a vehicle that is too fast would be matched as if it were just slow enough.
"""

RESOLVED = len(_RESOLVED)
"""So many of the speeds, the first ones, are resolved by the map."""

REACH = 12
"""Places that a step takes at most."""

UNKNOWN = -1.0
"""Stands for the length of a step that is not known."""

HYPOTHESES = np.array([0.2, 0.8])
"""Probability of the map and of its reverse, the null hypothesis, for a vehicle that is found."""

LOSE = 0.003
"""Chance that a vehicle that is on the map is lost at the next frame."""

FIND = 0.2
"""Chance that a vehicle that is lost is found on the map at the next frame."""

AGAIN = 0.1
"""How much of a frame's evidence for a place counts if the vehicle was there at the frame before.

Frames of one place resemble it for the same reasons, even for wrong ones: only a frame of another
place is independent evidence.
"""

_PRIOR = np.array([2, 1, 1, 1, 2, 2, 2, 8, 2, 2, 2, 2, 2, 1, 1, 0.5, 0.25, 0.25]) / 32
_PERSISTENCE = 60.0  # frames that a speed lasts
_STOP = 5.0  # frames that a stop lasts
_DEVIATION = 0.3  # of a step's length in the query from that in the map; descriptors have length 1
_NOISE = 0.05  # distance between frames of a stationary camera, as a fraction of a typical step
_STEPS = 250  # places whose steps are the sample


class Motion(NamedTuple):
    """The transition of S speeds.

    Attributes:
        prior: (S,) float32, chance of each speed, of a vehicle of unknown speed.
        change: (S,) float32, chance that the speed changes from one frame to the next; the same at
            all speeds but the first, the stationary one.
        chances: (S, REACH + 1) float32, chance of a step of 0, 1, … places at each speed.
        least: (S,) int32, least places of a step at each speed; the most are two more.
    """

    prior: Array
    change: Array
    chances: Array
    least: NDArray[np.int32]


class StepLengths(NamedTuple):
    """How long steps are on a map of K places, in descriptor space.

    Attributes:
        apart: (6, K) float32, distance of each place from the one before it, the second before it,
            and so on.
        sample: (6, J) float32, columns of ``apart`` that represent all of them.
        random_pairs: (J,) float32, distances of places from those half a map away.
        typical: length of a step of one place, the median.
        stationary: length of the step of a stationary vehicle.
    """

    apart: Array
    sample: Array
    random_pairs: Array
    typical: float
    stationary: float


def motion() -> Motion:
    """Return the transition of the speeds in ``SPEEDS``."""
    lasts = np.where(SPEEDS > 0, _PERSISTENCE, _STOP)
    chances = _step_chances()
    return Motion(
        _PRIOR.astype(np.float32),
        (1 / lasts).astype(np.float32),
        chances.astype(np.float32),
        np.argmax(chances > 0, axis=1).astype(np.int32),
    )


def _step_chances() -> NDArray[np.float64]:
    """Return the chance of a step of 0, 1, … places at each speed, (S, REACH + 1).

    A step that is not a whole number of places is one of the two nearest whole numbers, the nearer
    one more often. A speed stands for those around it, half way to the farther one of its
    neighbours, so that speeds between those of ``SPEEDS`` are followed as well.
    """
    gaps = np.diff([*_RESOLVED, 7])
    width = np.maximum(np.append(0, gaps[:-1]), gaps) / 2
    width[0] = 0  # a stationary vehicle does not move
    width = np.append(width, (0.5, 1, 1))
    around = SPEEDS[:, None] + width[:, None] * np.linspace(-1, 1, 201)
    exact = np.maximum(1 - np.abs(around[:, :, None] - np.arange(REACH + 1)), 0)
    chances = exact.mean(axis=1)
    return np.asarray(chances / chances.sum(axis=1, keepdims=True))


def step_lengths(apart: Array, random_pairs: Array) -> StepLengths:
    """Return the lengths of steps; see ``StepLengths`` for the arguments."""
    apart = apart.view()
    apart.flags.writeable = False  # as in a map on disk: kernels are compiled for one or the other
    typical = float(np.median(apart[0])) or 1.0
    stationary = _NOISE * typical
    sample = evenly_spaced(apart.T, _STEPS).T.copy()
    return StepLengths(apart, sample, random_pairs, typical, stationary)


def evenly_spaced(rows: Rows, most: int) -> Rows:
    """Return at most so many of the rows, evenly spaced, as a sample of all of them."""
    return cast(Rows, rows[:: -(-len(rows) // most)])


@kernel
def step_likelihoods(
    apart: Array, stationary: float, speeds: NDArray[np.float64], step: float, likelihoods: Array
) -> None:
    """Write the likelihood of a step's length at each speed, (S, K), by the place it leads to.

    Args:
        apart: (6, K) float32, see ``StepLengths``.
        stationary: see ``StepLengths``.
        speeds: (S,) float64, places per frame.
        step: length of the step; ``UNKNOWN`` has likelihood 1 at all speeds.
        likelihoods: (S, K) float32, receives them.
    """
    for row in range(len(speeds)):
        step_likelihood(apart, 0, stationary, speeds[row], step, likelihoods[row])


@kernel
def step_likelihood(
    apart: Array, first: int, stationary: float, speed: float, step: float, likelihoods: Array
) -> None:
    """Write the likelihood of a step's length at one speed, (n,), at places from ``first`` on."""
    if step < 0:
        likelihoods[:] = 1
        return
    walked, least = np.float32(max(step, stationary)), np.float32(stationary)
    end, low = first + len(likelihoods), int(speed)
    if low < 1:
        root, lengths = np.float32(math.sqrt(speed)), apart[0, first:end]
        for i in range(len(likelihoods)):
            length = least + (max(lengths[i], least) - least) * root
            likelihoods[i] = student(walked - length)
        return
    fraction = np.float32(speed - low)
    shorter = apart[min(low, len(apart)) - 1, first:end]
    longer = apart[min(low, len(apart) - 1), first:end]
    for i in range(len(likelihoods)):
        length = max(shorter[i] + (longer[i] - shorter[i]) * fraction, least)
        likelihoods[i] = student(walked - length)


@kernel
def mean_student(lengths: Array, step: float) -> float:
    """Return the mean likelihood of a step, given that its length is one of these, (J,)."""
    likelihoods = np.empty_like(lengths)
    for i in range(len(lengths)):
        likelihoods[i] = student(np.float32(step) - lengths[i])
    return sum_of(likelihoods) / len(lengths)


@kernel
def student(difference: np.float32) -> np.float32:
    """Return the density of Student's t with 2 degrees of freedom, without its constant factor.

    It tolerates outliers.
    """
    scaled = difference * np.float32(1 / _DEVIATION)
    spread = np.float32(1) + scaled * scaled * np.float32(0.5)
    density: np.float32 = np.float32(1) / (spread * np.sqrt(spread))
    return density
