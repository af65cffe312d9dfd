"""Compiled loops that turn a frame's distances from the places into evidence."""

import math

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel
from placefield.matching.motion import Array
from placefield.search.quantized import LONGEST

Distances = NDArray[np.int32]

_UNMAPPED_NEAR = 2 * LONGEST**2  # as ``near``, of a place whose cosine with the frame is half
_BEYOND = 0.02  # weight of a place's evidence beyond the bound


@kernel
def nearness(distances: Distances, first: int, count: int) -> Distances:
    """Return twice the squared distance of places (K,) from a frame, (K,) int32.

    It is the mean of the place's own distance and the least distance of the place and its two
    neighbours, because a frame between two places is far from both.

    Args:
        distances: (n,) int32, squared; neighbours before and after the places may be included.
        first: index of the first place in ``distances``.
        count: K.
    """
    near, last = np.empty(count, np.int32), len(distances) - 1
    here = distances[first : first + count]
    inner, own, behind = near[1:], here[1:], here[2:]
    for i in range(count - 2):
        around = min(here[i], own[i], behind[i])
        inner[i] = np.int32(own[i] + around)
    for i in (0, count - 1):
        before, after = distances[max(first + i - 1, 0)], distances[min(first + i + 1, last)]
        near[i] = np.int32(here[i] + min(before, here[i], after))
    return near


@kernel
def evidence_of(
    near: Distances,
    sample: Distances,
    every: int,
    nats: float,
    lost: float,
    unmapped: float,
    most: float,
) -> Array:
    """Return the evidence of a frame at places (K,) float32, see ``Observation``.

    No place can be likelier than the average one by more than the number of places. A sample may
    miss the observed place; the nearest place still counts most.

    Args:
        near: (K,) int32, see ``nearness``.
        sample: int32, the same of places that represent the whole map.
        every: only each so many-th place of the sample is used.
        nats: by which a frame is less likely where ``near`` is one more.
        lost: nats by which a frame is likelier when lost than at an average place.
        unmapped: fraction of places, beside those of the map, that are half alike.
        most: evidence beyond so many nats counts for little.
    """
    least = sample[0]
    for i in range(0, len(sample), every):
        least = min(least, sample[i])
    total, count = 0.0, 0
    for i in range(0, len(sample), every):
        total += math.exp(-nats * (sample[i] - least))
        count += 1
    mean = total / count
    if unmapped > 0:
        mean += unmapped * math.exp(-nats * (_UNMAPPED_NEAR - least))
    average = np.float32(math.log(mean) + lost)
    slope, highest, beyond = np.float32(-nats), np.float32(most), np.float32(_BEYOND)
    evidence = np.empty(len(near), np.float32)
    for i in range(len(near)):
        nats_of_place = slope * np.float32(np.int32(near[i] - least)) - average
        evidence[i] = min(nats_of_place, highest + beyond * (nats_of_place - highest))
    return evidence


@kernel
def step_length(descriptor: NDArray[np.int16], last: NDArray[np.int16], unit: float) -> float:
    """Return the distance of two quantized descriptors (M,), times the unit."""
    squares = np.int32(0)
    for m in range(len(descriptor)):
        difference = np.int32(np.int32(descriptor[m]) - np.int32(last[m]))
        squares = np.int32(squares + np.int32(difference * difference))
    return unit * math.sqrt(squares)
