"""Running sums of distances along the diagonals of the distance matrix.

A window of s frames compares query and reference frame by frame, at the same speed. Looking back,
it ends at query frame t and place j, and sums D(t - i, j - i) for i = 0 .. s - 1; looking ahead, it
begins there, and sums D(t + i, j + i). From frame to frame such a sum gains one distance and loses
one, so that its cost does not depend on s. Distances are whole numbers, so that sums are exact: in
whatever order they are added, and wherever a window begins, not one bit changes.
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
        places: how many are observed.
        rows: (R, C) int32, frame t in row t mod R, and place j of it in column (j - t) mod C: a
            diagonal keeps its column. Where it has left the map, and until it comes in again at the
            first place, it has the frame's mean distance, which speaks for no place and against
            none. A missing observation's are 0.
        before: (R,) int64, what a missing observation counts as looking back, from every place: the
            mean distance of the last observation. 0 for an observation, and before the first one.
        after: (R,) int64, the same looking ahead: that of the next observation, 0 until it comes.
        frames: how many there were.
        first: number of the first observation, ``frames`` before there was one.
        last: number of the last one, or -1.
    """

    def __init__(self, longest: int, places: int) -> None:
        """Prepare for windows of so many frames at most, over so many places."""
        self.places = places
        self.rows = np.zeros((longest + 1, places + longest), np.int32)
        self.before, self.after = np.zeros((2, longest + 1), np.int64)
        self.frames, self.first, self.last = 0, 0, -1
        self._mean = 0

    def update(self, distances: Distances, mean: int) -> None:
        """Take the newest frame's distances to the places, (K,) int32, and their mean.

        The mean is over all places of the map, which may be more than these.
        """
        rows, frame = self.rows, self.frames
        for missing in range(max(self.last + 1, frame - len(rows) + 1), frame):
            self.after[missing % len(rows)] = mean
        _enter(rows[frame % len(rows)], distances, -frame % rows.shape[1], mean)
        self._count(0)
        self.last, self._mean = frame, mean

    def update_missing(self) -> None:
        """Take a missing observation."""
        self.rows[self.frames % len(self.rows)] = 0
        self._count(self._mean)
        self.first += self.last < 0

    def _count(self, before: int) -> None:
        row = self.frames % len(self.rows)
        self.before[row], self.after[row] = before, 0
        self.frames += 1


class WindowSums:
    """The sums of all windows of one query frame, for several lengths at once.

    Looking back, it is the newest frame, and a young stream has windows as long as itself. Looking
    ahead, it is the newest one whose longest window is complete, and all is the mirror image: the
    places are in reverse order. A stream that has no more observations has windows that end with
    the last one; to those, missing observations after it are its end.

    Attributes:
        row_lengths: (n,) int64.
        columns: (n, C) float64, the sums of each length; see ``column``.
    """

    def __init__(
        self, recent: RecentDistances, lengths: Sequence[int], *, ahead: bool = False
    ) -> None:
        """Prepare windows of these lengths (frames, each at least 1) in a new stream."""
        self._recent, self._ahead = recent, ahead
        self.row_lengths = np.array(lengths, np.int64)
        self.delay = max(lengths) - 1 if ahead else 0
        """Frames from that whose windows these are to the newest one."""
        ends = self.delay + 1 - self.row_lengths if ahead else 0 * self.row_lengths
        self._windows = np.stack([ends, self.row_lengths, 0 * ends])
        self._missing = recent.after if ahead else recent.before
        self.columns = np.zeros((len(lengths), recent.rows.shape[1]))  # exact up to 2⁵³

    @property
    def frames(self) -> int:
        """How many frames a window may have: to the first observation, or to the last."""
        recent = self._recent
        if self._ahead:
            return max(recent.last - self._frame + 1, 0)
        return recent.frames - recent.first

    @property
    def _frame(self) -> int:
        return self._recent.frames - 1 - self.delay

    def slide(self) -> None:
        """Move on by a frame, to the newest of the recent ones."""
        rows, newest = self._recent.rows, self._recent.frames - 1
        _slide(self.columns, rows, self._missing, newest, self._windows, self._ahead)

    def column(self, place: int) -> int:
        """Return where a place's sums are in ``columns``; the next ones' follow it, and wrap."""
        first = self._frame - self._recent.places if self._ahead else -self._frame
        return (place + first) % self.columns.shape[1]


@kernel
def _enter(newest: Distances, distances: Distances, first: int, mean: int) -> None:
    """Write distances into their columns, from ``first`` on and around; their mean elsewhere."""
    newest[:] = mean
    before_wrap = min(len(newest) - first, len(distances))
    newest[first : first + before_wrap] = distances[:before_wrap]
    newest[: len(distances) - before_wrap] = distances[before_wrap:]


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
    sums: Sums, rows: Distances, missing: Numbers, newest: int, windows: Numbers, turned: bool
) -> None:
    """Add the frame that enters each window, and take away that which leaves.

    Of each window, (3, n): how many frames it ends before the newest, its length, and what it has
    from missing observations, which is brought up to date: theirs may just have become known.
    Frames before the stream are in rows that are 0 yet.
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
        if turned:
            _add_turned(sums[row], entering, leaving, shift)
        else:
            _add(sums[row], entering, leaving, shift)
