"""Running sums of distances along the diagonals of the distance matrix.

A window of s frames compares query and reference frame by frame, at the same speed. A backward
window ends at query frame t and place j, and sums D(t - i, j - i) for i = 0 .. s - 1. A forward
window begins there, and sums D(t + i, j + i). From frame to frame such a sum gains one distance and
loses one, so its cost does not depend on s. Distances are whole numbers, so the sums are exact:
neither the order of addition nor the start of a window changes a bit.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel

Distances = NDArray[np.int32]
Sums = NDArray[np.float64]
Numbers = NDArray[np.int64]


class RecentDistances:
    """The distances of the last frames of a stream, which windows are sums of.

    Attributes:
        places: how many are compared.
        rows: (R, C) int32, frame t in row t mod R, and place j in column (j - t) mod C, so that a
            diagonal keeps its column. Columns of no place have the frame's mean distance, which
            counts neither for a place nor against it. The row of a missing observation is 0.
        before: (R,) int64, distance of every place from a missing observation in backward windows:
            the mean distance of the last observation. 0 for an observation, and before the first
            one.
        after: (R,) int64, the same in forward windows: the mean distance of the next observation, 0
            until it comes.
        frames: how many there were.
        first: number of the first observation; ``frames`` before there is one.
        last: number of the last observation, or -1.
    """

    def __init__(self, longest: int, places: int) -> None:
        """Prepare for windows of at most so many frames, over so many places."""
        self.places = places
        self.rows = np.zeros((longest + 1, places + longest), np.int32)
        self.before, self.after = np.zeros((2, longest + 1), np.int64)
        self.frames, self.first, self.last = 0, 0, -1
        self._mean = 0

    def update(self, distances: Distances, mean: int) -> None:
        """Add the newest frame's distances to the places, (K,) int32, and their mean.

        The mean is over all places of the map, which may be more than these.
        """
        rows, frame = self.rows, self.frames
        for missing in range(max(self.last + 1, frame - len(rows) + 1), frame):
            self.after[missing % len(rows)] = mean
        _enter(rows[frame % len(rows)], distances, -frame % rows.shape[1], mean)
        self._count(0)
        self.last, self._mean = frame, mean

    def update_missing(self) -> None:
        """Add a missing observation."""
        self.rows[self.frames % len(self.rows)] = 0
        self._count(self._mean)
        self.first += self.last < 0

    def _count(self, before: int) -> None:
        row = self.frames % len(self.rows)
        self.before[row], self.after[row] = before, 0
        self.frames += 1


class WindowSums:
    """The sums of all windows of one query frame, for several lengths at once.

    Backward windows are those of the newest frame; in a young stream they are cut to its length.
    Forward windows are those of the newest frame whose longest window is complete. They are the
    mirror image: the places are in reverse order. After the last observation, forward windows are
    cut at it: for them, missing observations after the last one are the end of the stream.

    Attributes:
        row_lengths: (n,) int64, the lengths, ascending, each once.
        row_of: (m,) int64, the row of each given length.
        columns: (n, C) float64, the sums of each length; see ``column``.
    """

    def __init__(
        self, recent: RecentDistances, lengths: Sequence[int], *, forward: bool = False
    ) -> None:
        """Prepare windows of these lengths, (m,) frames, each at least 1, in a new stream."""
        self._recent, self._forward = recent, forward
        self.row_lengths, self.row_of = np.unique(np.array(lengths, np.int64), return_inverse=True)
        self.delay = max(lengths) - 1 if forward else 0
        """Frames from that whose windows these are to the newest one."""
        ends = self.delay + 1 - self.row_lengths if forward else 0 * self.row_lengths
        self._windows = np.stack([ends, self.row_lengths, 0 * ends])
        self._missing = recent.after if forward else recent.before
        self.columns = np.zeros((len(ends), recent.rows.shape[1]))  # exact up to 2⁵³

    @property
    def frames(self) -> int:
        """How many frames a window may have, back to the first observation or on to the last."""
        recent = self._recent
        if self._forward:
            return max(recent.last - self._frame + 1, 0)
        return recent.frames - recent.first

    @property
    def _frame(self) -> int:
        return self._recent.frames - 1 - self.delay

    def slide(self) -> None:
        """Move on by one frame, to the newest of the recent ones."""
        rows, newest = self._recent.rows, self._recent.frames - 1
        _slide(self.columns, rows, self._missing, newest, self._windows, self._forward)

    def column(self, place: int) -> int:
        """Return the column of a place's sums. Those of the next places follow, and wrap around."""
        first = self._frame - self._recent.places if self._forward else -self._frame
        return (place + first) % self.columns.shape[1]


@kernel
def _enter(newest: Distances, distances: Distances, first: int, mean: int) -> None:
    """Write distances into their columns, from ``first`` on and around; elsewhere their mean."""
    newest[:] = mean
    before_wrap = min(len(newest) - first, len(distances))
    for i in range(before_wrap):
        newest[first + i] = distances[i]
    for i in range(before_wrap, len(distances)):
        newest[i - before_wrap] = distances[i]


@kernel
def _add(sums: NDArray[np.float64], entering: Distances, leaving: Distances, shift: int) -> None:
    for column in range(len(sums)):
        sums[column] += np.float64(np.int32(entering[column] - leaving[column])) + shift


@kernel
def _add_turned(
    sums: NDArray[np.float64], entering: Distances, leaving: Distances, shift: int
) -> None:
    last = np.uint64(len(sums) - 1)  # a signed index might count from the end
    for column in range(len(sums)):
        other = last - np.uint64(column)
        sums[column] += np.float64(np.int32(entering[other] - leaving[other])) + shift


@kernel
def _slide(
    sums: Sums, rows: Distances, missing: Numbers, newest: int, windows: Numbers, reversed: bool
) -> None:
    """Add the frame that enters each window, and subtract the frame that leaves it.

    The rows of ``windows``, (3, n), are: the number of frames from a window's end to the newest
    frame, its length, and its sum of missing observations. The last is updated here, because the
    distance of a missing observation may just have become known. Frames before the stream are rows
    that are still 0.
    """
    for row in range(len(sums)):
        end = newest - windows[0, row]
        begin = end - windows[1, row]
        constant = 0
        for frame in range(max(begin + 1, 0), end + 1):
            constant += missing[frame % len(missing)]
        shift = constant - windows[2, row]
        windows[2, row] = constant
        entering, leaving = rows[end % len(rows)], rows[begin % len(rows)]
        if reversed:
            _add_turned(sums[row], entering, leaving, shift)
        else:
            _add(sums[row], entering, leaving, shift)
