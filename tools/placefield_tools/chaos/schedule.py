"""Draws a random schedule of faults; one seed gives one schedule.

Faults are scheduled by frame, not by time, so that a failed run can be repeated.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from placefield.errors import ConfigError

FaultKind = Literal[
    "kill channel",
    "kill featurizer",
    "kill fuser",
    "kill router",
    "kill channel and fuser",
    "kill featurizer and channel",
    "kill featurizer and fuser",
    "kill featurizer and channel and fuser",
    "stop channel",
    "garbage",
    "repeat",
]
KINDS: tuple[FaultKind, ...] = get_args(FaultKind)

APART = 60
"""Minimum number of frames between two faults: the system recovers before the next fault."""

_EDGE = 10
"""The first fault comes within so many frames of the stream's start, the last one of its end."""

_STOPPED = 30  # frames for which a worker is stopped


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes:
        kind: kind of the fault.
        at: number of the frame before which it begins.
        end: number of the frame before which it ends; ``at`` if it does not last.
        draw: random number that selects the worker or the messages.
        is_last: whether the stream ends too soon after the fault to show a recovery.
    """

    kind: FaultKind
    at: int
    end: int
    draw: int
    is_last: bool = False


def schedule(seed: int, frames: int, faults: int) -> list[Fault]:
    """Draw so many faults over a stream of so many frames, by ascending frame.

    Each kind comes once before any comes again. The first fault is among the first frames,
    and the last of several among the last frames.

    Raises:
        ConfigError: the stream is too short for so many faults.
    """
    if frames < (faults + 1) * APART:
        raise ConfigError(
            f"--frames {frames}: too few for {faults} faults; give {(faults + 1) * APART} or more"
        )
    rng = np.random.default_rng(seed)
    spare = frames - (faults + 1) * APART
    places = np.arange(faults) * APART + np.sort(rng.integers(0, spare + 1, faults))
    if faults:
        places[0] = rng.integers(1, _EDGE + 1)
    if faults > 1:
        places[-1] = frames - rng.integers(1, _EDGE + 1)
    kinds: list[FaultKind] = []
    while len(kinds) < faults:
        kinds += [KINDS[number] for number in rng.permutation(len(KINDS))]
    return [
        _fault(kind, at, int(rng.integers(2**31)), frames)
        for kind, at in zip(kinds, places.tolist(), strict=False)
    ]


def _fault(kind: FaultKind, at: int, draw: int, frames: int) -> Fault:
    end = min(at + _STOPPED, frames - 1) if kind == "stop channel" else at
    return Fault(kind, at, end, draw, is_last=at > frames - APART)
