"""Running sums of distances along the diagonals of the distance matrix.

A window of s frames that ends at query frame t and place j sums D(t - i, j - i) for i = 0 .. s - 1:
query and reference are compared frame by frame, at the same speed, looking back. From frame to
frame such a sum moves one place on, gains one distance and loses one, so that its cost does not
depend on s.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.matching.distances import on_grid


class WindowSums:
    """The sums of all windows that end at the newest query frame, for several lengths at once.

    A young stream has windows as long as itself. Where a window reaches back beyond the first
    place, the query frame's mean distance stands for the missing ones: it speaks for no place and
    against none.
    """

    def __init__(self, lengths: Sequence[int], places: int) -> None:
        """Prepare windows of the given lengths (frames, each at least 1) over so many places."""
        self.lengths = tuple(lengths)
        self.frames = 0
        # Column 0 stands for all that lies before the first place.
        self._sums = np.zeros((len(lengths), places + 1))
        self._ring = np.zeros((max(lengths), places + 1), np.float32)

    def push(self, distances: NDArray[np.float32]) -> None:
        """Take the newest frame's distances to all places, (K,) float32 on the grid."""
        # In float64 the mean of equal distances is that distance, to the bit.
        mean = on_grid(distances.mean(keepdims=True, dtype=np.float64))
        newest = np.concatenate([mean, distances])
        self._sums[:, 1:] = self._sums[:, :-1]
        self._sums += newest
        for sums, length in zip(self._sums, self.lengths, strict=True):
            if self.frames >= length:
                leaving = self._ring[(self.frames - length) % len(self._ring)]
                sums[length:] -= leaving[: max(len(leaving) - length, 0)]
                sums[:length] -= leaving[0]
        self._ring[self.frames % len(self._ring)] = newest
        self.frames += 1

    def push_unseen(self) -> None:
        """Take a frame that was not seen: from every place as far as the last one on average.

        A stream begins with the first frame that was seen; those before it are not counted.
        """
        if self.frames == 0:
            return
        last_mean = self._ring[(self.frames - 1) % len(self._ring), 0]
        self.push(np.full(self._sums.shape[1] - 1, last_mean))

    @property
    def sums(self) -> NDArray[np.float64]:
        """Sum of each window, (lengths, K); entry j is of the window that ends at place j."""
        return self._sums[:, 1:]
