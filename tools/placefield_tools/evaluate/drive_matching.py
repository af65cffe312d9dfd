"""Descriptors to matches, at once and in hindsight; frames are compared with the places once."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.map import MapChannel, Places
from placefield.matching.channel_stage import ChannelStage

Descriptors = Sequence[NDArray[np.float32] | None]


@dataclass(frozen=True, eq=False)
class Metres:
    """How far a drive of Q frames has come, and the K places of its map.

    Attributes:
        places: that know how far they are, and which of them are the same.
        readings: Q of the odometer, None where nobody knows.
    """

    places: Places
    readings: Sequence[float | None]


@dataclass(frozen=True)
class Matches:
    """The matches of a drive of Q frames.

    Attributes:
        causal: Q, each of what came before.
        smoothed: by lag, Q each, of at most so many frames after it too.
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
    """Match a whole stream of descriptors (N,), None for a missing observation.

    Args:
        channels: that match, whole ones.
        descriptors: Q.
        metres: of the drive.
        config: how; its lag counts for nothing.
        lags: of the smoothed matches, or ``WHOLE_DRIVE``.
    """
    places = metres.places
    stage = ChannelStage(
        dict(enumerate(channels)), config, travelled=places.travelled, same=places.same
    )
    fusion = FusionStage(places.same, config, places.pose)
    streams = {lag: FusedStream(stage, fusion, lag) for lag in lags or (0,)}
    smoothed: dict[int, list[SmoothedMatch]] = {lag: [] for lag in lags}
    compared = stage.compare([one for one in descriptors if one is not None])
    causal = []
    for descriptor, reading in zip(descriptors, metres.readings, strict=True):
        frame = None if descriptor is None else next(compared)
        matches = [stream.update(frame, reading) for stream in streams.values()]
        causal.append(matches[0])  # of all of them the same
        for lag in lags:
            smoothed[lag] += streams[lag].smoothed()
    for lag in lags:
        smoothed[lag] += streams[lag].finish()
    return Matches(causal, smoothed)
