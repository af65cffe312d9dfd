"""Other reference traverses, aligned to the first; those that do not show its route are refused.

Their frames are matched against the first's as those of a drive are, by GIST, whatever the map's
feature: it tells day from night least. Poses on earth will do as well. So will numbers, if frames
resemble the places of their own number more than others.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.config import FeatureKind
from placefield.errors import MapError
from placefield.features.descriptors import fit_descriptors
from placefield.features.extract import default_dimensions, feature_of
from placefield.maps.alignment import (
    align_by_number,
    align_by_poses,
    align_by_smoother,
)
from placefield.maps.geography import Origin
from placefield.maps.traverse import NO_PLACE, Alignment, Traverse

log = logging.getLogger(__name__)

LEAST_SHOWN = 0.3
"""Share of the frames, or of the places, that must be recognised.

Of the frames of real routes, by day and night, 37 % are at least.
"""

_ALIGNED = 5.0  # deviations: real routes that differ reach 4
_LEAST_FRAMES = 40  # of fewer the matcher cannot be sure
_TOO_FEW = 8  # no map is built of these
_SLACK = 2  # places

_KIND: FeatureKind = "gist"

Array = NDArray[np.float32]


def align_traverses(traverses: Sequence[Traverse], kind: FeatureKind) -> list[Traverse]:
    """Return the traverses of one map, each but the first aligned to the first.

    The poses decide if both have them on earth, else what the frames show. If that says too
    little, and a traverse has as many frames as the first, they may be aligned by number: where
    they resemble their places so, or are too few to tell, which is logged.

    Args:
        traverses: of one map, the first gives the places. If these are too few for a map, nothing
            is aligned.
        kind: of their raw features.

    Raises:
        MapError: a traverse shows another route than the first.
    """
    first, *others = traverses
    if not others or len(first.raw) <= _TOO_FEW:
        return list(traverses)
    reference = _raws(first, kind)
    return [
        first,
        *(replace(each, alignment=_align(first, reference, each, kind)) for each in others),
    ]


def _align(first: Traverse, reference: Array, other: Traverse, kind: FeatureKind) -> Alignment:
    count = len(first.raw)
    by_poses = _by_poses(first, other)
    if by_poses is not None and _shows(by_poses, count):
        return by_poses
    places, frames = fit_descriptors(
        [reference, _raws(other, kind)],
        _KIND,
        dimensions=default_dimensions(_KIND),
        standardise=True,
    )[1]
    recognised = align_by_smoother(places, frames)
    if _shows(recognised, count):
        return recognised
    if len(other.raw) == count:
        if _alignment(frames @ places.T) >= _ALIGNED:
            return align_by_number(count)
        if count < _LEAST_FRAMES:
            log.warning(
                "%s: %.0f%% of its %d frames are recognised in %s, which is too short to tell "
                "whether it shows the same route",
                other.name,
                100 * recognised.aligned / count,
                count,
                first.name,
            )
            return align_by_number(count)
    raise MapError(
        f"{other.name}: does not show the route of {first.name}: "
        f"{recognised.aligned / len(other.raw):.0%} of its frames are recognised there, and "
        f"{LEAST_SHOWN:.0%} have to be; build a map of its own, or give --one-drive if they are "
        "parts of one"
    )


def _shows(alignment: Alignment, count: int) -> bool:
    """Return whether a drive shows a route of so many places, or itself for the most part."""
    shown = len(np.setdiff1d(alignment.places, NO_PLACE))
    return alignment.aligned >= LEAST_SHOWN * len(alignment.places) or shown >= LEAST_SHOWN * count


def _by_poses(first: Traverse, other: Traverse) -> Alignment | None:
    """Align by poses; None where those of either are not on earth."""
    ours, theirs = Origin.of_frame(first.pose_frame), Origin.of_frame(other.pose_frame)
    if ours is None or theirs is None or not (len(first.poses) and len(other.poses)):
        return None
    poses = other.poses.copy()
    for pose in (row for row in poses if np.isfinite(row[0])):
        pose[:2] = ours.to_local(*theirs.to_degrees(*pose[:2]))
    return align_by_poses(first.poses, poses)


def _raws(traverse: Traverse, kind: FeatureKind) -> Array:
    if kind == _KIND:
        return traverse.raw
    feature = feature_of(_KIND)
    return np.stack([feature.describe(image) for image in traverse.thumbnails])


def _alignment(similarities: Array) -> float:
    """Return by how many deviations frames resemble places of their number more than others.

    Args:
        similarities: (K, K), of frames and places. The mean over the frames, of places so many
            further on, all the way round, is compared with that of none.
    """
    count = len(similarities)
    numbers = np.arange(count)
    shifted = np.array(
        [similarities[numbers, (numbers + by) % count].mean() for by in range(count)]
    )
    near = max(_SLACK + 1, count // 20)
    far = shifted[near : count - near + 1]
    if far.std() == 0:
        return 0.0
    own = max(shifted[by] for by in range(-_SLACK, _SLACK + 1))
    return float((own - far.mean()) / far.std())
