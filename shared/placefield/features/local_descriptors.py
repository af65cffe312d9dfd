"""Raw features to descriptors along one drive that has no reference.

There is no reference to fit a mean, a deviation or a PCA on. A frame is standardised by the mean
and deviation of the last frames instead. That removes what neighbouring frames have in common,
which says least about the place, and it follows the light. Frames of a vehicle that stands still
would soon be all of the last frames, so a frame counts by its novelty.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.features.descriptors import is_blank, unit_length

SPAN = 20.0
"""Novelty, in average steps, within which frames are neighbours and look alike."""

_MOVED = 0.25  # least novelty of a frame on which the vehicle moved
_LEAST_DEVIATION = 1e-6

Array = NDArray[np.float32]
Array64 = NDArray[np.float64]


class LocalDescriptor(NamedTuple):
    """A frame as it differs from the last frames.

    Attributes:
        frame: its number in the drive, from 0.
        vector: (D,) float32, the descriptor, of length 1. While the vehicle stands, it stays as it
            is.
        travelled: sum of the novelty of the frames so far, average steps.
    """

    frame: int
    vector: Array
    travelled: float


class LocalDescriptors:
    """Turns the raw features of a drive into descriptors, frame by frame and causally.

    The novelty of a frame is its distance from the last frame on which the vehicle moved, in
    average steps, at most 1. Below a quarter, the vehicle stands. The first frames wait until the
    sum of their novelty is ``SPAN``, and have one mean and deviation.
    """

    def __init__(self) -> None:
        """Begin a drive."""
        self.frames = 0
        """Number of frames so far."""
        self._first: list[LocalDescriptor] | None = []
        self._last: Array | None = None
        self._newest: LocalDescriptor | None = None
        self._steps, self._count = 0.0, 0  # sum and number of the steps so far
        self._travelled, self._weight = 0.0, 0.0
        self._sums: Array64 = np.zeros((2, 1))

    def update(self, raw: Array | None) -> list[LocalDescriptor]:
        """Return the descriptors that the next frame's raw feature, (D,) float32, completes.

        The list is empty while the first frames wait, for a frame that was not observed (None), and
        for a constant raw feature, as of a blank image. Then it has all first frames at once, and
        after that the frame itself.

        Raises:
            FrameError: the feature has another shape than those before, or is not finite; the frame
                does not count.
        """
        if raw is not None:
            self._check(raw)
        self.frames += 1
        if raw is None or is_blank(raw):
            return []
        unit = unit_length(raw)
        number = self.frames - 1
        if not self._moves(unit):
            return [] if self._newest is None else [self._newest._replace(frame=number)]
        frame = LocalDescriptor(number, unit, self._travelled)
        if self._first is None:
            self._newest = self._standardised(frame)
            return [self._newest]
        self._first.append(frame)
        if self._travelled < SPAN:
            return []
        described = [self._standardised(each) for each in self._first]
        self._first, self._newest = None, described[-1]
        return described

    def _check(self, raw: Array) -> None:
        if self._last is not None and raw.shape != self._last.shape:
            raise FrameError(f"feature of shape {raw.shape}, not {self._last.shape}")
        if not np.isfinite(raw).all():
            raise FrameError("the feature is not finite")

    def _moves(self, unit: Array) -> bool:
        """Add a feature at unit length to the last frames; False if the vehicle stands."""
        novelty = 1.0
        if self._last is not None:
            step = float(np.linalg.norm(unit - self._last))
            average = (self._steps + step) / (self._count + 1)
            if step < _MOVED * average or step == 0:
                return False
            novelty = min(1.0, step / average)
            self._steps, self._count = self._steps + step, self._count + 1
            self._travelled += novelty
        self._last = unit
        kept = 1 - novelty / SPAN
        self._weight = kept * self._weight + novelty
        self._sums = kept * self._sums + novelty * np.stack([unit, unit.astype(np.float64) ** 2])
        return True

    def _standardised(self, frame: LocalDescriptor) -> LocalDescriptor:
        """Standardise the feature at unit length, (D,), by the last frames."""
        mean, square_mean = self._sums / self._weight
        variance = np.maximum(square_mean - mean**2, _LEAST_DEVIATION**2)
        standardised = (frame.vector - mean) / np.sqrt(variance)
        return frame._replace(vector=unit_length(standardised.astype(np.float32)))
