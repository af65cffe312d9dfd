"""What a frame's distances from the places are evidence of, in compiled loops."""

import math

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.motion import Array

Distances = NDArray[np.int32]

_BEYOND = 0.02  # share of a place's evidence that counts beyond what it can have


@kernel
def nearness(distances: Distances, first: int, near: Distances) -> None:
    """Write twice the squared distance of places (K,) from a frame.

    It is the mean of a place's own and the least of its own and its two neighbours': from a frame
    that was taken between two places both are far.

    Args:
        distances: (n,) int32, squared; before and after the places may be neighbours.
        first: which of them is of the first place.
        near: (K,) int32, receives it.
    """
    count, last = len(near), len(distances) - 1
    here = distances[first : first + count]
    inner, own, behind = near[1:], here[1:], here[2:]
    for i in range(count - 2):
        around = min(here[i], own[i], behind[i])
        inner[i] = np.int32(own[i] + around)
    for i in (0, count - 1):
        before, after = distances[max(first + i - 1, 0)], distances[min(first + i + 1, last)]
        near[i] = np.int32(here[i] + min(before, here[i], after))


@kernel
def evidence_of(
    near: Distances, some: Distances, every: int, nats: float, lost: float, evidence: Array
) -> None:
    """Write the evidence of a frame at places (K,), see ``Observation``.

    No place is more times likelier than the average one than there are places. Where some of them
    stand for all, the one that is observed may be missing; who is nearest still counts most.

    Args:
        near: (K,) int32, see ``nearness``.
        some: int32, the same of places that stand for all of the map.
        every: of these, one of so many is looked at.
        nats: by which a frame is less likely where ``near`` is one more.
        lost: nats by which it is likelier, when lost, than at an average place.
        evidence: (K,) float32, receives it.
    """
    least = some[0]
    for i in range(0, len(some), every):
        least = min(least, some[i])
    total, count = 0.0, 0
    for i in range(0, len(some), every):
        total += math.exp(-nats * (some[i] - least))
        count += 1
    average = np.float32(math.log(total / count) + lost)
    slope = np.float32(-nats)
    for i in range(len(near)):
        evidence[i] = slope * np.float32(np.int32(near[i] - least)) - average


@kernel
def bound(evidence: Array, most: float) -> None:
    """Let evidence, (K,) float32, count for little beyond so many nats."""
    highest, beyond = np.float32(most), np.float32(_BEYOND)
    for i in range(len(evidence)):
        evidence[i] = min(evidence[i], highest + beyond * (evidence[i] - highest))


@kernel
def step_length(codes: NDArray[np.int16], last: NDArray[np.int16], unit: float) -> float:
    """How far apart two vectors of codes are."""
    squares = np.int32(0)
    for m in range(len(codes)):
        difference = np.int32(np.int32(codes[m]) - np.int32(last[m]))
        squares = np.int32(squares + np.int32(difference * difference))
    return unit * math.sqrt(squares)
