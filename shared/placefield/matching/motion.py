"""How a vehicle moves along the places of a map: the motion model of the rule ``filter``.

A vehicle drives at one of some speeds, from standing to six places per frame, and keeps it for a
while. How long its steps are, in descriptor space, belongs to the speed: a frame is expected to be
as far from the last one as places are from each other that the vehicle passes in that time. Below
one place per frame that grows with the square root of the speed, as a random walk does.
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

The last three stand for what is faster than the map resolves: who drives so is not known to be
anywhere. Without them, a vehicle that is too fast would be taken for one that just is not.
"""

RESOLVED = len(_RESOLVED)
"""So many of the speeds, the first, the map resolves."""

REACH = 12
"""Places that a step takes at most."""

UNKNOWN = -1.0
"""Length of a step of which nothing is known."""

HYPOTHESES = np.array([0.2, 0.8])
"""Share of a vehicle that is found that the map has, and its reverse, the null hypothesis."""

LOSE = 0.003
"""Chance that a vehicle that is on the map is lost at the next frame."""

FIND = 0.2
"""Chance that one that is lost is on the map at the next frame."""

AGAIN = 0.1
"""How much of a frame's evidence for a place counts if the vehicle was there at the frame before.

What the frames of one place have in common with it they have together, be it by mistake: only a
further place is a further look.
"""

_PRIOR = np.array([2, 1, 1, 1, 2, 2, 2, 8, 2, 2, 2, 2, 2, 1, 1, 0.5, 0.25, 0.25]) / 32
_PERSISTENCE = 60.0  # frames that a speed lasts
_STOP = 5.0  # frames that a stop lasts
_DEVIATION = 0.3  # between the lengths of a step in two traverses; descriptors have length 1
_NOISE = 0.05  # share of a typical step that the frames of a standing camera differ by
_STEPS = 250  # places whose steps stand for all


class Motion(NamedTuple):
    """The transition of S speeds.

    Attributes:
        prior: (S,) float32, chance of each speed, of a vehicle of which nothing is known.
        change: (S,) float32, chance that the speed changes from one frame to the next; the same at
            all speeds but the first, at which the vehicle stands.
        chances: (S, REACH + 1) float32, chance that a step takes 0, 1, … places at each speed.
        least: (S,) int32, places that one takes at least, and two more at most.
    """

    prior: Array
    change: Array
    chances: Array
    least: NDArray[np.int32]


class StepLengths(NamedTuple):
    """How long steps are on a map of K places, in descriptor space.

    Attributes:
        apart: (6, K) float32, how far each place is from the one before it, the second before it,
            and so on.
        some: (6, J) float32, some of them, that stand for all.
        random_pairs: (J,) float32, how far places are from those half a map away.
        typical: length of a step of one place, the median.
        standing: of no step.
    """

    apart: Array
    some: Array
    random_pairs: Array
    typical: float
    standing: float


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
    """Chance that a step takes 0, 1, … places at each speed, (S, REACH + 1).

    Between two whole steps, the nearer oftener. A speed stands for those around it, half way to the
    farther one of its neighbours, so that those that are not in ``SPEEDS`` are followed as well.
    """
    gaps = np.diff([*_RESOLVED, 7])
    width = np.maximum(np.append(0, gaps[:-1]), gaps) / 2
    width[0] = 0  # who stands, stands
    width = np.append(width, (0.5, 1, 1))
    around = SPEEDS[:, None] + width[:, None] * np.linspace(-1, 1, 201)
    exact = np.maximum(1 - np.abs(around[:, :, None] - np.arange(REACH + 1)), 0)
    chances = exact.mean(axis=1)
    return np.asarray(chances / chances.sum(axis=1, keepdims=True))


def step_lengths(apart: Array, random_pairs: Array) -> StepLengths:
    """Return the lengths of steps; see ``StepLengths`` for the arguments."""
    typical = float(np.median(apart[0])) or 1.0
    standing = _NOISE * typical
    some = evenly_spaced(apart.T, _STEPS).T.copy()
    return StepLengths(apart, some, random_pairs, typical, standing)


def evenly_spaced(rows: Rows, most: int) -> Rows:
    """Return so many of the rows at most, evenly spaced, to stand for all of them."""
    return cast(Rows, rows[:: -(-len(rows) // most)])


@kernel
def step_likelihoods(
    apart: Array, standing: float, speeds: NDArray[np.float64], step: float, likelihoods: Array
) -> None:
    """Write how likely a step of a length is at each speed, (S, K), by the place it leads to.

    Args:
        apart: (6, K) float32, see ``StepLengths``.
        standing: see there.
        speeds: (S,) float64, places per frame.
        step: length of the step; ``UNKNOWN`` is as likely as not at all speeds: 1.
        likelihoods: (S, K) float32, receives them.
    """
    for row in range(len(speeds)):
        step_likelihood(apart, 0, standing, speeds[row], step, likelihoods[row])


@kernel
def step_likelihood(
    apart: Array, first: int, standing: float, speed: float, step: float, likelihoods: Array
) -> None:
    """Write the same at one speed, (n,), of places from ``first`` on."""
    if step < 0:
        likelihoods[:] = 1
        return
    walked, least = np.float32(max(step, standing)), np.float32(standing)
    end, low = first + len(likelihoods), int(speed)
    if low < 1:
        root, lengths = np.float32(math.sqrt(speed)), apart[0, first:end]
        for i in range(len(likelihoods)):
            length = least + (max(lengths[i], least) - least) * root
            likelihoods[i] = student(walked - length)
        return
    share = np.float32(speed - low)
    shorter = apart[min(low, len(apart)) - 1, first:end]
    longer = apart[min(low, len(apart) - 1), first:end]
    for i in range(len(likelihoods)):
        length = max(shorter[i] + (longer[i] - shorter[i]) * share, least)
        likelihoods[i] = student(walked - length)


@kernel
def mean_student(lengths: Array, step: float) -> float:
    """Return how likely a step is that is as long as any of these, (J,)."""
    likelihoods = np.empty_like(lengths)
    for i in range(len(lengths)):
        likelihoods[i] = student(np.float32(step) - lengths[i])
    return sum_of(likelihoods) / len(lengths)


@kernel
def student(difference: np.float32) -> np.float32:
    """Density of Student's t with 2 degrees of freedom, up to a factor: it forgives outliers."""
    scaled = difference * np.float32(1 / _DEVIATION)
    spread = np.float32(1) + scaled * scaled * np.float32(0.5)
    density: np.float32 = np.float32(1) / (spread * np.sqrt(spread))
    return density
