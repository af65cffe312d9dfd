"""Which faults befall a stream, and at which of its frames: drawn by chance, the same by one seed.

Faults are told by frames rather than by seconds, so that a run that failed can be run again.
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
    "stop channel",
    "garbage",
    "repeat",
]
KINDS: tuple[FaultKind, ...] = get_args(FaultKind)

APART = 60
"""Frames between two faults at least: before the next one, all is well again."""

_STOPPED = 30  # frames for which a worker is stopped


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong.

    Attributes:
        kind: what it is.
        at: number of the frame before which it happens.
        end: of the frame before which it is over; ``at`` if it only happens.
        draw: what is left to chance in it: which worker, which messages.
    """

    kind: FaultKind
    at: int
    end: int
    draw: int


def schedule(seed: int, frames: int, faults: int) -> list[Fault]:
    """Draw so many faults over a stream of so many frames, by ascending frame.

    Each kind comes once before any comes again.

    Raises:
        ConfigError: the stream is too short for them.
    """
    if frames < (faults + 1) * APART:
        raise ConfigError(
            f"--frames {frames}: too few for {faults} faults; give {(faults + 1) * APART} or more"
        )
    rng = np.random.default_rng(seed)
    spare = frames - (faults + 1) * APART
    delays = np.sort(rng.integers(0, spare + 1, faults))
    kinds: list[FaultKind] = []
    while len(kinds) < faults:
        kinds += [KINDS[number] for number in rng.permutation(len(KINDS))]
    return [
        _fault(kind, (number + 1) * APART + int(delay), int(rng.integers(2**31)))
        for number, (kind, delay) in enumerate(zip(kinds, delays, strict=False))
    ]


def _fault(kind: FaultKind, at: int, draw: int) -> Fault:
    return Fault(kind, at, at + _STOPPED if kind == "stop channel" else at, draw)
