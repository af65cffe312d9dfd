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

_LEAST_DEVIATION = 1e-6

Array = NDArray[np.float32]
Array64 = NDArray[np.float64]


class LocalDescriptor(NamedTuple):
    """A frame as it differs from the last frames.

    Attributes:
        frame: its number in the drive, from 0.
        vector: (D,) float32, the descriptor, of length 1.
        travelled: sum of the novelty of the frames so far, average steps.
    """

    frame: int
    vector: Array
    travelled: float


class LocalDescriptors:
    """Turns the raw features of a drive into descriptors, frame by frame and causally.

    The novelty of a frame is its distance from the frame before, in average steps, at most 1. The
    first frames wait until their novelty is ``SPAN``, and have one mean and deviation.
    """

    def __init__(self) -> None:
        """Begin a drive."""
        self.frames = 0
        """Number of frames so far."""
        self._first: list[LocalDescriptor] | None = []
        self._last: Array | None = None
        self._steps, self._count = 0.0, 0
        self._travelled, self._weight = 0.0, 0.0
        self._sums: Array64 | None = None

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
        self._learn(unit, self._novelty(unit))
        frame = LocalDescriptor(self.frames - 1, unit, self._travelled)
        if self._first is None:
            return [self._standardised(frame)]
        self._first.append(frame)
        if self._travelled < SPAN:
            return []
        first, self._first = self._first, None
        return [self._standardised(each) for each in first]

    def _check(self, raw: Array) -> None:
        if self._last is not None and raw.shape != self._last.shape:
            raise FrameError(f"feature of shape {raw.shape}, not {self._last.shape}")
        if not np.isfinite(raw).all():
            raise FrameError("the feature is not finite")

    def _novelty(self, unit: Array) -> float:
        last, self._last = self._last, unit
        if last is None:
            return 1.0
        step = float(np.linalg.norm(unit - last))
        self._steps += step
        self._count += 1
        novelty = min(1.0, step * self._count / self._steps) if self._steps > 0 else 0.0
        self._travelled += novelty
        return novelty

    def _learn(self, unit: Array, novelty: float) -> None:
        kept = 1 - novelty / SPAN
        new = novelty * np.stack([unit, unit.astype(np.float64) ** 2])
        self._sums = new if self._sums is None else kept * self._sums + new
        self._weight = kept * self._weight + novelty

    def _standardised(self, frame: LocalDescriptor) -> LocalDescriptor:
        """Standardise the feature at unit length, (D,), by the last frames."""
        assert self._sums is not None
        mean, square_mean = self._sums / self._weight
        variance = np.maximum(square_mean - mean**2, _LEAST_DEVIATION**2)
        standardised = (frame.vector - mean) / np.sqrt(variance)
        return frame._replace(vector=unit_length(standardised.astype(np.float32)))
