"""The local features of a map's places, and what their number of inliers says."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.verification.likelihood import learn_ratios
from placefield.verification.local_features import LocalFeatures
from placefield.verification.two_views import count_inliers

_PAIRS = 150  # of views of one place, and as many of two places
_APART = 3  # places, at most, between two views of one place on one traverse
_PARTS = (1, 2, 4, 8)  # one of so many inliers remains in other light, each equally likely
_FAR = 0.1  # of the map, at least, between two places

Views = Sequence[tuple[int, LocalFeatures]]
"""Places, and what a frame of each shows."""


@dataclass(frozen=True, eq=False)
class PlaceFeatures:
    """The local features of the K places of a map.

    Attributes:
        points: (n, 2) float32, see ``LocalFeatures``; those of the first place, then of the second,
            and so on.
        descriptors: (n, 128) uint8.
        ends: (K,) int64, where those of each place end.
        ratios: (L,) float64, the likelihood ratios of 0, 1, … inliers, see ``learn_ratios``.
    """

    points: NDArray[np.float32]
    descriptors: NDArray[np.uint8]
    ends: NDArray[np.int64]
    ratios: NDArray[np.float64]

    @property
    def most(self) -> int:
        """The most local features of a place."""
        return int(np.diff(self.ends, prepend=0).max())

    def of(self, place: int) -> LocalFeatures:
        """Return the local features of a place."""
        own = slice(self.ends[place - 1] if place else 0, self.ends[place])
        return LocalFeatures(self.points[own], self.descriptors[own])

    def with_places(self, views: Sequence[LocalFeatures]) -> "PlaceFeatures":
        """Return them with those of further places; the likelihood ratios stay."""
        return self._of([*map(self.of, range(len(self.ends))), *views])

    def kept(self, places: NDArray[np.integer]) -> "PlaceFeatures":
        """Return those of the places with these numbers; the likelihood ratios stay."""
        return self._of([self.of(place) for place in places.tolist()])

    def _of(self, views: Sequence[LocalFeatures]) -> "PlaceFeatures":
        return PlaceFeatures(*stacked(views), self.ratios)


def features_of_places(
    places: Sequence[LocalFeatures], again: Views, same: NDArray[np.int32], seed: int
) -> PlaceFeatures | None:
    """Gather the local features of K places, and learn what a number of inliers says.

    Pairs of views of one place are those of other traverses with the place. If there are none,
    they are views that are 1 to 3 places apart on the first traverse. These are in the same light,
    and have more inliers than a later drive will have. So it is taken as equally likely that all
    of them remain, half, a quarter or an eighth, but not fewer than views of two places have by
    chance. Views of two places are at least a tenth of the map apart.

    Args:
        places: K, of the first traverse.
        again: places, and the local features of frames of other traverses that show them.
        same: (K,), the earliest place that shows the same stretch as each.
        seed: of the choice of pairs, and of RANSAC.

    Returns:
        The local features; None if no place has any, or if the map is too small for such pairs.
    """
    pairs = again or _neighbours(places)
    rng = np.random.default_rng(seed)
    chosen = sorted(rng.permutation(len(pairs))[:_PAIRS].tolist())
    ours, theirs = [], []
    for number in chosen:
        place, view = pairs[number]
        far = np.flatnonzero(_is_far(place, same))
        if len(far):
            other = int(rng.choice(far))
            ours.append(count_inliers(view, places[place], seed))
            theirs.append(count_inliers(view, places[other], seed))
    if not ours or not any(len(place.points) for place in places):
        return None
    by_chance = np.array(theirs)
    found = np.array(ours) if again else _remaining(np.array(ours), by_chance)
    return PlaceFeatures(*stacked(places), learn_ratios(found, by_chance))


def stacked(
    views: Sequence[LocalFeatures],
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.int64]]:
    """Return the points and descriptors of places one after another, and where each place ends."""
    return (
        np.concatenate([view.points for view in views]),
        np.concatenate([view.descriptors for view in views]),
        np.cumsum([len(view.points) for view in views], dtype=np.int64),
    )


def _neighbours(places: Sequence[LocalFeatures]) -> Views:
    return [(place, places[place + 1 + place % _APART]) for place in range(len(places) - _APART)]


def _remaining(inliers: NDArray[np.int64], by_chance: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([np.maximum(inliers // part, by_chance) for part in _PARTS])


def _is_far(place: int, same: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return which places are far from a place, and from those that show the same."""
    numbers = np.arange(len(same))
    reach = max(_FAR * len(same), 2 * _APART + 1)
    # A place that shows the same as another is as far from the rest as that one is.
    return np.asarray(
        (np.abs(numbers - place) > reach)
        & (np.abs(same - same[place]) > reach)
        & (np.abs(numbers - same[place]) > reach)
    )


def problem_with(found: PlaceFeatures) -> str | None:
    """Describe what is wrong with local features from a file; None if they are sound."""
    counts = np.diff(found.ends, prepend=0)
    if counts.min() < 0 or found.ends[-1] != len(found.points):
        return "do not belong to the map's places"
    if not np.isfinite(found.points).all():
        return "a point is not finite"
    ratios = found.ratios
    if not (len(ratios) and np.isfinite(ratios).all() and (ratios > 0).all()):
        return "a likelihood ratio is not above 0"
    return None
