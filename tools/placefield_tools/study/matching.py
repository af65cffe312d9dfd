"""Matches a stream by channels; candidates of a channel are reused in many combinations."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from placefield.config import MatchingConfig
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match
from placefield.maps.map import MapChannel
from placefield.matching.candidate import Candidate
from placefield.matching.channel_stage import ChannelStage
from placefield_tools.evaluate.drive_matching import Descriptors, Metres, match_drive


def match_channels(
    channels: Sequence[MapChannel],
    descriptors: Descriptors,
    metres: Metres,
    config: MatchingConfig,
) -> list[Match]:
    """Match a stream of descriptors (N,), None for a missing observation, by some channels."""
    return match_drive(channels, descriptors, metres, config).causal


def smoothed_candidates(
    channels: Sequence[MapChannel],
    descriptors: Descriptors,
    metres: Metres,
    config: MatchingConfig,
) -> list[list[Candidate]]:
    """Return each channel's smoothed candidate for each frame of a stream.

    A frame is compared with the places once for all channels that share a metric.
    """
    topology = metres.placemap.topology
    stage = ChannelStage(dict(enumerate(channels)), config, topology=topology)
    stream = stage.new_stream()
    compared = stage.compare([one for one in descriptors if one is not None])
    for descriptor, reading in zip(descriptors, metres.readings, strict=True):
        stream.update(None if descriptor is None else next(compared), reading)
    for _ in range(stream.end()):
        stream.update(None)
    stream.finish()
    smoothed = stream.smoothed()
    return [[each.candidate for _, each in smoothed[number]] for number in range(len(channels))]


def fuse_channels(candidates: Sequence[Sequence[Candidate]], fusion: FusionStage) -> list[Match]:
    """Fuse the candidates of some channels frame by frame."""
    return [fusion.fuse(of_frame) for of_frame in zip(*candidates, strict=True)]


def with_scales(channel: MapChannel, scales: Sequence[int]) -> MapChannel:
    """Return a channel that matches at other scales, frames, and at no smaller one."""
    sizes = np.array(sorted(set(scales)), np.int32)
    return replace(channel, scales=sizes, smallest=int(sizes[0]))


def median_scale(channel: MapChannel) -> int:
    """Return the middle one of a channel's scales, the longer of two."""
    return int(np.sort(channel.scales)[len(channel.scales) // 2])
