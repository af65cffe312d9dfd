"""Channels to matches; the candidates of a channel serve in many combinations."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.maps.map import MapChannel, MapMetric
from placefield.matching.candidate import Candidate
from placefield.matching.channel_matcher import matcher_of
from placefield.matching.comparing import Comparison, MetricPlaces

Descriptors = Sequence[NDArray[np.float32] | None]


def match_channels(
    channels: Sequence[MapChannel], descriptors: Descriptors, config: MatchingConfig
) -> list[Match]:
    """Match a stream of descriptors (N,), None where a frame was not seen, by some channels."""
    return fuse_channels(candidates_of(channels, descriptors, config), config)


def candidates_of(
    channels: Sequence[MapChannel], descriptors: Descriptors, config: MatchingConfig
) -> list[list[Candidate]]:
    """Return each channel's candidate for each frame of a stream.

    A frame is compared with the places once for all channels that share a metric.
    """
    matchers = [matcher_of(one, config.rule, reverse=config.reverse) for one in channels]
    metrics = dict.fromkeys(channel.metric for channel in channels)
    compared = {metric: _compare(metric, descriptors, config) for metric in metrics}
    candidates: list[list[Candidate]] = [[] for _ in channels]
    for _ in descriptors:
        frames = {metric: next(of_metric) for metric, of_metric in compared.items()}
        for channel, matcher, own in zip(channels, matchers, candidates, strict=True):
            own.append(matcher.push(frames[channel.metric]))
    return candidates


def _compare(
    metric: MapMetric, descriptors: Descriptors, config: MatchingConfig
) -> Iterator[Comparison | None]:
    """Yield how each frame compares with the places, None for one that was not seen."""
    seen = [one for one in descriptors if one is not None]
    places = MetricPlaces(metric, exact=config.compares_exactly)
    frames = places.compare(np.stack(seen)) if seen else iter(())
    return (None if one is None else next(frames) for one in descriptors)


def fuse_channels(candidates: Sequence[Sequence[Candidate]], config: MatchingConfig) -> list[Match]:
    """Fuse the candidates of some channels frame by frame."""
    return [fuse(of_frame, config) for of_frame in zip(*candidates, strict=True)]


def with_scales(channel: MapChannel, scales: Sequence[int]) -> MapChannel:
    """Return a channel that matches at other scales, frames."""
    return replace(channel, scales=np.array(sorted(set(scales)), np.int32))


def median_scale(channel: MapChannel) -> int:
    """Return the middle one of a channel's scales, the longer of two."""
    return int(np.sort(channel.scales)[len(channel.scales) // 2])
