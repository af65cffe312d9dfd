"""Aligns traverses to the first one, or to the places of a map, and refuses those of another route.

Georeferenced poses decide if both traverses have them. Otherwise the frames are recognised in the
first traverse like those of a query. If too few are recognised, the traverses may be aligned by
number, if frames resemble the places of their own index more than other places. Frames are compared
by GIST, whatever the map's feature, because GIST depends least on the time of day. A map of
descriptors has no images, so its descriptors are compared.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.features.extract import default_dimensions, feature_of
from placefield.features.fitting import fit_descriptors
from placefield.features.kinds import DESCRIPTOR, FeatureKind
from placefield.maps.alignment import align_by_number, align_by_poses, align_by_smoother
from placefield.maps.geography import Origin
from placefield.maps.map import Map, MapMetric
from placefield.maps.map_metrics import identity_metric
from placefield.maps.topology import Topology
from placefield.maps.traverse import NO_PLACE, Alignment, Traverse
from placefield.matching.revisits import same_places

log = logging.getLogger(__name__)

LEAST_SHOWN = 0.3
"""Least fraction of the frames that show a place, or of the places that are shown.

On real routes, by day and night, at least 0.37 of the frames show a place.
"""

_ALIGNED = 5.0  # standard deviations: different real routes reach 4
_LEAST_FRAMES = 40  # with fewer, the matcher cannot become certain
_TOO_FEW = 8  # too few frames for a map
_SLACK = 2  # places

_KIND: FeatureKind = "gist"

Array = NDArray[np.float32]


def align_traverses(traverses: Sequence[Traverse], kind: FeatureKind) -> list[Traverse]:
    """Return the traverses of one map, each but the first aligned to the first.

    If the poses and the smoother recognise too little, a traverse with as many frames as the first
    is aligned by number: if its frames resemble the places of their own index, or if there are too
    few frames to decide, which is logged.

    Args:
        traverses: of one map; the first gives the places. If it has too few for a map, nothing is
            aligned, and ``build_map`` refuses it.
        kind: of their raw features.

    Raises:
        MapError: a traverse shows another route, or its features have another dimension.
    """
    first, *others = traverses
    for other in others:
        if other.raw.shape[1] != first.raw.shape[1]:
            raise MapError(
                f"{other.name}: features of {other.raw.shape[1]} dimensions, and those of "
                f"{first.name} have {first.raw.shape[1]}; give features of one kind"
            )
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
    if by_poses is not None and _shows_route(by_poses, count):
        return by_poses
    _, (places, frames) = fit_descriptors(
        [reference, _raws(other, kind)],
        _KIND,
        dimensions=default_dimensions(_KIND),
        standardise=True,
    )
    smoothed = align_by_smoother(
        identity_metric(places),
        replace(Topology.line(len(places)), same=same_places(places)),
        frames,
    )
    if _shows_route(smoothed, count):
        return smoothed
    if len(other.raw) == count:
        if _alignment(frames @ places.T) >= _ALIGNED:
            return align_by_number(count)
        if count < _LEAST_FRAMES:
            log.warning(
                "%s: %.0f%% of its %d frames are recognised in %s, which is too short to decide if "
                "both show one route",
                other.name,
                100 * smoothed.aligned / count,
                count,
                first.name,
            )
            return align_by_number(count)
    raise MapError(
        f"{other.name}: does not show the route of {first.name}: only "
        f"{smoothed.aligned / len(other.raw):.0%} of its frames are recognised there, and "
        f"{LEAST_SHOWN:.0%} are needed; build a separate map, or give --one-drive if both are "
        "parts of one drive"
    )


def align_to_map(
    opened: Map, identity: MapMetric, traverse: Traverse, descriptors: Array
) -> Alignment:
    """Align a drive to the places of a map, by poses or by the smoother.

    Args:
        opened: the map.
        identity: its identity metric.
        traverse: the drive of M frames; its poses are in the map's coordinate frame.
        descriptors: (M, N) float32, of its frames.

    Raises:
        MapError: the drive does not show the route.
    """
    count = opened.places.count
    if len(opened.places.poses) and len(traverse.poses):
        by_poses = align_by_poses(opened.places.poses, traverse.poses)
        if _shows_route(by_poses, count):
            return by_poses
    smoothed = align_by_smoother(identity, opened.topology, descriptors)
    if _shows_route(smoothed, count):
        return smoothed
    raise MapError(
        f"{traverse.name}: does not show the route of the map: only "
        f"{smoothed.aligned / len(descriptors):.0%} of its frames are recognised there, and "
        f"{LEAST_SHOWN:.0%} are needed; build a separate map"
    )


def poses_in_map(frame: str | None, traverse: Traverse) -> NDArray[np.float64]:
    """Return a drive's poses in a map's coordinate frame, (M, 3), or (0, 3).

    There are none if either poses are not georeferenced.

    Args:
        frame: name of the map's coordinate frame; None if it has no poses.
        traverse: the drive.
    """
    ours = None if frame is None else Origin.of_frame(frame)
    theirs = Origin.of_frame(traverse.pose_frame)
    if ours is None or theirs is None:
        return np.empty((0, 3))
    poses = traverse.poses.copy()
    for pose in (row for row in poses if np.isfinite(row[0])):
        pose[:2] = ours.to_local(*theirs.to_degrees(*pose[:2]))
    return poses


def _shows_route(alignment: Alignment, count: int) -> bool:
    """Return whether enough of a drive's frames show a place, or enough of the places are shown."""
    shown = len(np.setdiff1d(alignment.places, NO_PLACE))
    return alignment.aligned >= LEAST_SHOWN * len(alignment.places) or shown >= LEAST_SHOWN * count


def _by_poses(first: Traverse, other: Traverse) -> Alignment | None:
    """Align by poses; return None if those of either traverse are not georeferenced."""
    poses = poses_in_map(first.pose_frame, other)
    return align_by_poses(first.poses, poses) if len(first.poses) and len(poses) else None


def _raws(traverse: Traverse, kind: FeatureKind) -> Array:
    if kind in (_KIND, DESCRIPTOR):
        return traverse.raw
    feature = feature_of(_KIND)
    return np.stack([feature.describe(image) for image in traverse.thumbnails])


def _alignment(similarities: Array) -> float:
    """Return by how many standard deviations frames resemble places of their own index more.

    For each shift, the mean similarity of frame i and place i + shift (cyclic) is computed. Small
    shifts are compared with large ones.

    Args:
        similarities: (K, K), frames by places.
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
