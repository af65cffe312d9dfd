"""Learns on the reference how many inliers views of two places have by chance."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.verification.local_features import LocalFeatures
from placefield.verification.place_features import NO_RATIOS, PlaceFeatures, stacked
from placefield.verification.two_views import count_inliers

_PAIRS = 150  # of views of two places
_LEAST_FAR = 7  # places, at least, between two places
_FAR = 0.1  # of the map, at least, between two places

Views = Sequence[tuple[int, LocalFeatures]]
"""Places, and what a frame of each shows."""


def features_of_places(
    places: Sequence[LocalFeatures], again: Views, same: NDArray[np.int32], seed: int
) -> PlaceFeatures | None:
    """Gather the local features of K places, and count the inliers of views of two places.

    Two places are at least a tenth of the map apart. The view of the one is that of another
    traverse, if there is one: it is in other light, as a later drive will be.

    Args:
        places: K, of the first traverse.
        again: places, and the local features of frames of other traverses that show them.
        same: (K,), the earliest place that shows the same stretch as each.
        seed: of the choice of pairs, and of RANSAC.

    Returns:
        The local features; None if no place has any, or if the map is too small for such pairs.
    """
    views = again or list(enumerate(places))
    rng = np.random.default_rng(seed)
    by_chance = []
    for number in sorted(rng.permutation(len(views))[:_PAIRS].tolist()):
        place, view = views[number]
        far = np.flatnonzero(_is_far(place, same))
        if len(far):
            by_chance.append(count_inliers(view, places[int(rng.choice(far))], seed))
    if not by_chance or not any(len(place.points) for place in places):
        return None
    return PlaceFeatures(*stacked(places), NO_RATIOS, np.array(by_chance, np.int64))


def _is_far(place: int, same: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return which places are far from a place, and from those that show the same."""
    numbers = np.arange(len(same))
    reach = max(_FAR * len(same), _LEAST_FAR)
    # A place that shows the same as another is as far from the rest as that one is.
    return np.asarray(
        (np.abs(numbers - place) > reach)
        & (np.abs(same - same[place]) > reach)
        & (np.abs(numbers - same[place]) > reach)
    )
