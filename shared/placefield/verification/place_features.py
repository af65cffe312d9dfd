"""The local features of a map's places, as the map keeps them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.verification.local_features import MOST_NUMBERS, LocalFeatures

NO_RATIOS = np.empty(0)
"""Of a map whose verification learns along the drive."""

NO_PAIRS = np.empty(0, np.int64)
"""Of a map of an earlier version."""


@dataclass(frozen=True, eq=False)
class PlaceFeatures:
    """The local features of the K places of a map.

    Attributes:
        points: (n, 2) float32, see ``LocalFeatures``; those of the first place, then of the second,
            and so on.
        descriptors: (n, D) uint8.
        ends: (K,) int64, where those of each place end.
        ratios: (L,) float64, of a map of an earlier version, the likelihood ratios of 0, 1, …
            inliers. The last one is that of more inliers, too. Empty otherwise.
        by_chance: (O,) int64, inliers of pairs of views of two places; empty if there are ratios.
        onnx: (bytes,) uint8, the file of the network that gives the local features; None: SIFT.
    """

    points: NDArray[np.float32]
    descriptors: NDArray[np.uint8]
    ends: NDArray[np.int64]
    ratios: NDArray[np.float64]
    by_chance: NDArray[np.int64]
    onnx: NDArray[np.uint8] | None = None

    @property
    def most(self) -> int:
        """The most local features of a place."""
        return int(np.diff(self.ends, prepend=0).max())

    def of(self, place: int) -> LocalFeatures:
        """Return the local features of a place."""
        own = slice(self.ends[place - 1] if place else 0, self.ends[place])
        return LocalFeatures(self.points[own], self.descriptors[own])

    def with_places(self, views: Sequence[LocalFeatures]) -> "PlaceFeatures":
        """Return them with those of further places; what was learned stays."""
        return self._of([*map(self.of, range(len(self.ends))), *views])

    def kept(self, places: NDArray[np.integer]) -> "PlaceFeatures":
        """Return those of the places with these numbers; what was learned stays."""
        return self._of([self.of(place) for place in places.tolist()])

    def _of(self, views: Sequence[LocalFeatures]) -> "PlaceFeatures":
        return PlaceFeatures(*stacked(views), self.ratios, self.by_chance, self.onnx)


def stacked(
    views: Sequence[LocalFeatures],
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.int64]]:
    """Return the points and descriptors of places one after another, and where each place ends."""
    filled = [view for view in views if len(view.points)] or views[:1]  # see NO_FEATURES
    return (
        np.concatenate([view.points for view in filled]),
        np.concatenate([view.descriptors for view in filled]),
        np.cumsum([len(view.points) for view in views], dtype=np.int64),
    )


def problem_with(found: PlaceFeatures) -> str | None:
    """Describe what is wrong with local features from a file; None if they are sound."""
    counts = np.diff(found.ends, prepend=0)
    if counts.min() < 0 or found.ends[-1] != len(found.points):
        return "do not belong to the map's places"
    if not np.isfinite(found.points).all():
        return "a point is not finite"
    if not 0 < found.descriptors.shape[1] <= MOST_NUMBERS:
        return f"a descriptor has no number, or more than {MOST_NUMBERS}"
    ratios, by_chance = found.ratios, found.by_chance
    if not (np.isfinite(ratios).all() and (ratios > 0).all()):
        return "a likelihood ratio is not above 0"
    if by_chance.min(initial=0) < 0:
        return "a number of inliers is below 0"
    if len(ratios) == len(by_chance) == 0:
        return "nothing was learned of inliers"
    return None
