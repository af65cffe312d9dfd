"""Running sums of distances along the diagonals of the distance matrix.

A window of s frames that ends at query frame t and place j sums D(t - i, j - i) for i = 0 .. s - 1:
query and reference are compared frame by frame, at the same speed, looking back. From frame to
frame such a sum gains one distance and loses one, so that its cost does not depend on s. Distances
are whole numbers, so that sums are exact: in whatever order they are added, and wherever a window
begins, not one bit changes.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel

Distances = NDArray[np.int32]
Sums = NDArray[np.float64]


class WindowSums:
    """The sums of all windows that end at the newest query frame, for several lengths at once.

    A young stream has windows as long as itself. Where a window reaches back beyond the first
    place, the query frame's mean distance stands for the missing ones: it speaks for no place and
    against none.
    """

    def __init__(self, lengths: Sequence[int], places: int, unit: float = 1.0) -> None:
        """Prepare windows of these lengths (frames, each at least 1) over so many places.

        Distances are in squared units of this length.
        """
        self.row_lengths = np.array(lengths, np.int64)
        self.places = places
        self.unit = unit
        self.frames = 0
        self._mean = 0
        # A diagonal keeps its column; what has left the map at its last place is fed with means
        # until it comes in again at the first. Whole numbers as float64: exact up to 2⁵³.
        self.columns = np.zeros((len(lengths), places + max(lengths)))
        self._ring = np.zeros((max(lengths) + 1, self.columns.shape[1]), np.int32)

    def push(self, distances: Distances, mean: int) -> None:
        """Take the newest frame's distances to the places, (K,) int32, and their mean.

        The mean is over all places of the map, which may be more than these.
        """
        newest = self._ring[self.frames % len(self._ring)]
        self._mean = mean
        _enter(newest, distances, -self.frames % self.columns.shape[1], mean)
        _slide(self.columns, self._ring, self.frames, self.row_lengths)
        self.frames += 1

    def push_unseen(self) -> None:
        """Take a missing observation: from every place as far as the last one on average.

        A stream begins with the first observation; frames before it are not counted.
        """
        if self.frames:
            self.push(np.full(self.places, self._mean, np.int32), self._mean)

    def column(self, place: int) -> int:
        """Return where a place's sums are in ``columns``; the next ones' follow it, and wrap."""
        return (place - max(self.frames - 1, 0)) % self.columns.shape[1]


@kernel
def _enter(newest: Distances, distances: Distances, first: int, mean: int) -> None:
    """Write distances into their columns, from ``first`` on and around; their mean elsewhere."""
    newest[:] = mean
    before_wrap = min(len(newest) - first, len(distances))
    newest[first : first + before_wrap] = distances[:before_wrap]
    newest[: len(distances) - before_wrap] = distances[before_wrap:]


@kernel
def _slide(sums: Sums, ring: Distances, frame: int, lengths: NDArray[np.int64]) -> None:
    """Add the distances of a frame, whose row is in the ring, and take away what leaves."""
    newest = ring[frame % len(ring)]
    for row in range(len(lengths)):
        if frame < lengths[row]:
            for column in range(len(newest)):
                sums[row, column] += newest[column]
        else:
            leaving = ring[(frame - lengths[row]) % len(ring)]
            for column in range(len(newest)):
                sums[row, column] += newest[column] - leaving[column]
