"""Matching before the first frame, so that none waits for what is made at its first use."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from placefield.config import MatchingConfig
from placefield.maps.layout import CHANNEL_FILES, COARSE_FILES, METRIC_FILES, Layout
from placefield.maps.map import MapChannel
from placefield.matching.channel_matcher import matcher_of
from placefield.matching.comparing import MetricPlaces

_PLACES = 100  # compiled code is the same for any number of them

Part = TypeVar("Part", bound=Any)


def rehearse(channels: Iterable[MapChannel], matching: MatchingConfig) -> None:
    """Match frames of no stream along the first places of each channel."""
    for channel in map(beginning_of, channels):
        frame = np.eye(1, channel.metric.projection.shape[1], dtype=np.float32)
        places = MetricPlaces(channel.metric, exact=matching.compares_exactly)
        matcher = matcher_of(channel, matching.rule, reverse=matching.reverse)
        for compared in places.compare(np.concatenate([frame, -frame, frame])):
            matcher.push(compared)
            matcher.push(None)


def beginning_of(channel: MapChannel) -> MapChannel:
    """Return the first places of a channel, views of its arrays."""
    metric = channel.metric
    coarse = metric.coarse and _beginning(metric.coarse, COARSE_FILES)
    short = replace(_beginning(metric, METRIC_FILES), coarse=coarse)
    return replace(_beginning(channel, CHANNEL_FILES), metric=short)


def _beginning(part: Part, layout: Layout) -> Part:
    """Cut every array that has an axis of places."""
    cut = {
        name: getattr(part, name)[tuple(slice(_PLACES if axis == "K" else None) for axis in axes)]
        for name, (_, axes) in layout.items()
    }
    return replace(part, **cut)
