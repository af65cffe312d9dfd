"""Matching the descriptors of a drive: causal and smoothed matches from one comparison."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.features.joined_model import AnyModel
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.map import Map, MapChannel
from placefield.matching.channel_stage import ChannelStage

RawFeature = NDArray[np.float32] | None
"""A frame's raw feature, (D,); None if the frame cannot be read."""

Descriptors = Sequence[NDArray[np.float32] | None]
"""The descriptors of a drive, (N,) each, None for a missing observation."""


def descriptors_of(model: AnyModel, raws: Sequence[RawFeature]) -> Descriptors:
    """Return the descriptors of a stream of frames."""
    stream = model.new_stream()
    return [None if raw is None else stream.update(raw) for raw in raws]


@dataclass(frozen=True, eq=False)
class Metres:
    """The odometry of a drive of Q frames, and its map.

    Attributes:
        placemap: whose places have their metres travelled.
        readings: Q readings of the odometry, metres, None where unknown.
    """

    placemap: Map
    readings: Sequence[float | None]


@dataclass(frozen=True)
class Matches:
    """The matches of a drive of Q frames.

    Attributes:
        causal: Q matches, each from the frames up to it.
        smoothed: for each lag, Q matches, each also from up to ``lag`` later frames.
    """

    causal: list[Match]
    smoothed: dict[int, list[SmoothedMatch]]


def match_drive(
    channels: Sequence[MapChannel],
    descriptors: Descriptors,
    metres: Metres,
    config: MatchingConfig,
    lags: Collection[int] = (),
) -> Matches:
    """Match a whole stream of descriptors, once for all lags.

    Args:
        channels: whole channels.
        descriptors: Q descriptors.
        metres: of the drive.
        config: of the matching; its lag is not used.
        lags: lags of the smoothed matches, or ``WHOLE_DRIVE``.
    """
    topology = metres.placemap.topology
    stage = ChannelStage(dict(enumerate(channels)), config, topology=topology)
    fusion = FusionStage(topology, config, metres.placemap.places.pose)
    stream = FusedStream(stage, fusion, tuple(lags))
    smoothed: dict[int, list[SmoothedMatch]] = {lag: [] for lag in lags}
    compared = stage.compare([one for one in descriptors if one is not None])
    causal = []
    for descriptor, reading in zip(descriptors, metres.readings, strict=True):
        frame = None if descriptor is None else next(compared)
        causal.append(stream.update(frame, reading))
        for which, of_lag in enumerate(smoothed.values()):
            of_lag += stream.smoothed(which)
    stream.finish()
    for which, of_lag in enumerate(smoothed.values()):
        of_lag += stream.smoothed(which)
    return Matches(causal, smoothed)
