"""Descriptors to matches, at once and in hindsight; frames are compared with the places once."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.map import MapChannel
from placefield.matching.channel_stage import ChannelStage

Descriptors = Sequence[NDArray[np.float32] | None]


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
    config: MatchingConfig,
    lags: Collection[int] = (),
) -> Matches:
    """Match a whole stream of descriptors (N,), None for a missing observation.

    Args:
        channels: that match, whole ones.
        descriptors: Q.
        config: how; its lag counts for nothing.
        lags: of the smoothed matches, or ``WHOLE_DRIVE``.
    """
    stage = ChannelStage(dict(enumerate(channels)), config)
    fusion = FusionStage(len(channels[0].metric.places), config)
    streams = {lag: FusedStream(stage, fusion, lag) for lag in lags or (0,)}
    smoothed: dict[int, list[SmoothedMatch]] = {lag: [] for lag in lags}
    compared = stage.compare([one for one in descriptors if one is not None])
    causal = []
    for descriptor in descriptors:
        frame = None if descriptor is None else next(compared)
        matches = [stream.push(frame) for stream in streams.values()]
        causal.append(matches[0])  # of all of them the same
        for lag in lags:
            smoothed[lag] += streams[lag].smoothed()
    for lag in lags:
        smoothed[lag] += streams[lag].finish()
    return Matches(causal, smoothed)
