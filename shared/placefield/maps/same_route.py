"""A check that the other reference traverses show the route of the first.

A traverse passes one of two tests. Either enough of its frames are known when they are matched
against the first traverse like a drive. Or its frames resemble the places of their own index more
than other places, because traverses are aligned by index. Both tests use GIST, whatever the map's
feature, because GIST depends least on the time of day.
"""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import FeatureKind, MatchingConfig
from placefield.errors import MapError
from placefield.features.descriptors import fit_descriptors
from placefield.features.extract import default_dimensions, feature_of
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.maps.map import MapChannel
from placefield.maps.map_metrics import identity_metric
from placefield.maps.traverse import Traverse
from placefield.matching.channel_stage import ChannelStage

log = logging.getLogger(__name__)

LEAST_KNOWN = 0.3
"""Fraction of frames that must be known; on real routes, by day and night, it is at least 0.37."""

_ALIGNED = 5.0  # standard deviations: different real routes reach 4
_LEAST_FRAMES = 40  # with fewer, the matcher cannot become certain
_TOO_FEW = 8  # too few frames for a map
_SLACK = 2  # places

_KIND: FeatureKind = "gist"

Array = NDArray[np.float32]


def check_same_route(traverses: Sequence[Traverse], kind: FeatureKind) -> None:
    """Refuse a traverse that shows another route than the first.

    A traverse that is too short for a verdict is only logged. Traverses of different lengths, or
    too short for a map, are not checked here: ``build_map`` refuses them.

    Args:
        traverses: of one map; the first gives the places.
        kind: of their raw features.

    Raises:
        MapError: a traverse shows another route.
    """
    first, *others = traverses
    others = [other for other in others if len(other.raw) == len(first.raw)]
    if not others or len(first.raw) <= _TOO_FEW:
        return
    reference = _raws(first, kind)
    for other in others:
        known, is_same = _alike(reference, _raws(other, kind))
        if is_same:
            continue
        if len(first.raw) >= _LEAST_FRAMES:
            raise MapError(
                f"{other.name}: does not show the route of {first.name}: only {known:.0%} of its "
                f"frames are recognised there, and {LEAST_KNOWN:.0%} are needed; build a separate "
                "map, or give --one-drive if both are parts of one drive"
            )
        log.warning(
            "%s: %.0f%% of its %d frames are recognised in %s, which is too short to decide if "
            "both show one route",
            other.name,
            100 * known,
            len(other.raw),
            first.name,
        )


def _raws(traverse: Traverse, kind: FeatureKind) -> Array:
    if kind == _KIND:
        return traverse.raw
    feature = feature_of(_KIND)
    return np.stack([feature.describe(image) for image in traverse.thumbnails])


def _alike(reference: Array, other: Array) -> tuple[float, bool]:
    """Return the fraction of frames that are known, and whether the route is the same."""
    _, (places, frames) = fit_descriptors(
        [reference, other], _KIND, dimensions=default_dimensions(_KIND), standardise=True
    )
    known = _known(places, frames)
    return known, known >= LEAST_KNOWN or _alignment(frames @ places.T) >= _ALIGNED


def _known(places: Array, frames: Array) -> float:
    """Return the fraction of frames (K, N) that are known among the places (K, N), smoothed."""
    matching, count = MatchingConfig(), len(places)
    channels = ChannelStage({0: _channel(places)}, matching)
    fusion = FusionStage(np.arange(count, dtype=np.int32), matching)
    stream = FusedStream(channels, fusion, matching.lag)
    smoothed = []
    for frame in frames:
        stream.update(next(channels.compare([frame])))
        smoothed += stream.smoothed()
    smoothed += stream.finish()
    return float(np.mean([bool(each.match.known) for each in smoothed]))


def _channel(places: Array) -> MapChannel:
    """Return a channel without segments."""
    count, one = len(places), np.ones(1, np.int32)
    none = np.zeros((0, 2), np.int32)
    labels = np.zeros(count, np.int32)
    return MapChannel(1, 1, identity_metric(places), labels, none, one, 1, np.zeros((0, 2)))


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
