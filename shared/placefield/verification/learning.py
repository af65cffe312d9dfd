"""Learns on the reference what a number of inliers says."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.verification.likelihood import learn_ratios
from placefield.verification.local_features import LocalFeatures
from placefield.verification.place_features import PlaceFeatures, stacked
from placefield.verification.two_views import LEAST, count_inliers

_PAIRS = 150  # of views of one place, and as many of two places
_APART = 3  # places, at most, between two views of one place on one traverse
_PARTS = (1, 2, 4, 8)  # one of so many inliers remains in other light, each equally likely
_FAR = 0.1  # of the map, at least, between two places

Views = Sequence[tuple[int, LocalFeatures]]
"""Places, and what a frame of each shows."""


def features_of_places(
    places: Sequence[LocalFeatures],
    again: Views,
    same: NDArray[np.int32],
    bounds: Sequence[tuple[int, int]],
    seed: int,
) -> PlaceFeatures | None:
    """Gather the local features of K places, and learn what a number of inliers says.

    Pairs of views of one place are those of other traverses with the place. If there are none,
    they are views that are 1 to 3 places apart on one route of the first traverse. These are in the
    same light, and have more inliers than a later drive will have. So it is taken as equally likely
    that all of them remain, half, a quarter or an eighth, but not fewer than views of two places
    have by chance. Views of two places are at least a tenth of the map apart.

    Args:
        places: K, of the first traverse.
        again: places, and the local features of frames of other traverses that show them.
        same: (K,), the earliest place that shows the same stretch as each.
        bounds: of each route, its first place, and its last one + 1.
        seed: of the choice of pairs, and of RANSAC.

    Returns:
        The local features; None if no place has any, or if the map is too small for such pairs.
    """
    pairs = again or _neighbours(places, bounds)
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


def _neighbours(places: Sequence[LocalFeatures], bounds: Sequence[tuple[int, int]]) -> Views:
    return [
        (place, places[place + 1 + place % _APART])
        for first, end in bounds
        for place in range(first, end - _APART)
    ]


def _remaining(inliers: NDArray[np.int64], by_chance: NDArray[np.int64]) -> NDArray[np.int64]:
    parts = [np.maximum(inliers // part, by_chance) for part in _PARTS]
    return np.concatenate([np.where(part < LEAST, by_chance, part) for part in parts])


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
