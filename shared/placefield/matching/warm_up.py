"""Matches frames before the first real one, so that none waits for compilation."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from placefield.config import MatchingConfig
from placefield.maps.array_layout import CHANNEL_FILES, COARSE_FILES, METRIC_FILES, Layout
from placefield.maps.map import MapChannel
from placefield.maps.topology import Topology
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.comparing import has_lists
from placefield.search.coarse import CoarseIndex

_PLACES = 100  # compiled code is the same for any number of them

Part = TypeVar("Part", bound=Any)


def warm_up(channels: Iterable[MapChannel], matching: MatchingConfig, topology: Topology) -> None:
    """Match frames of no stream along the first places of each channel.

    This compiles all that whole channels use, and their shards.

    Args:
        channels: of one map.
        matching: how candidates are made.
        topology: of the map.
    """
    short = dict(enumerate(map(beginning_of, channels)))
    topology = _topology_like(topology, len(short[0].metric.places))
    used = [short]
    if any(has_lists(channel.metric) for channel in short.values()):
        used.append({number: _without_lists(channel) for number, channel in short.items()})
    for each in used:
        stage = ChannelStage(each, matching, topology=topology)
        _match(stage, measured=False)
        if len(topology.travelled):
            _match(stage, measured=True)


def _topology_like(topology: Topology, count: int) -> Topology:
    """Return a topology of ``count`` places that needs the same compiled code: line or circuit."""
    like = replace(Topology.line(count), travelled=topology.travelled[:count])
    if not len(topology.graph.links):
        return like
    return replace(like, graph=like.graph.with_links([(count - 1, 0)]))


def _match(stage: ChannelStage, *, measured: bool) -> None:
    """Match frames that follow each other, then frames after missing observations.

    ``measured`` says whether frames have readings of the odometry.
    """
    stream, frame = stage.new_stream(), np.eye(1, stage.dimensions, dtype=np.float32)[0]
    compared = list(stage.compare([frame, -frame, frame]))
    for observed in (*compared, *(one for each in compared for one in (None, each))):
        reading = float(stream.next) if measured and observed is not None else None
        stream.update(observed, reading)


def beginning_of(channel: MapChannel) -> MapChannel:
    """Return the first places of a channel, as views of its arrays."""
    metric = channel.metric
    coarse = metric.coarse and _beginning_of_index(metric.coarse)
    looks = metric.looks and metric.looks.between(0, _PLACES)
    short = replace(_beginning(metric, METRIC_FILES), coarse=coarse, looks=looks)
    return replace(_beginning(channel, CHANNEL_FILES), metric=short)


def _without_lists(channel: MapChannel) -> MapChannel:
    """Return a channel as its shards are, which use no inverted lists."""
    coarse = channel.metric.coarse and replace(channel.metric.coarse, lists=None)
    return replace(channel, metric=replace(channel.metric, coarse=coarse))


def _beginning_of_index(coarse: CoarseIndex) -> CoarseIndex:
    lists = coarse.lists and coarse.lists.beginning(_PLACES)
    return replace(_beginning(coarse, COARSE_FILES), lists=lists)


def _beginning(part: Part, layout: Layout) -> Part:
    """Cut every array that has an axis of places."""
    cut = {
        name: getattr(part, name)[tuple(slice(_PLACES if axis == "K" else None) for axis in axes)]
        for name, (_, axes) in layout.items()
    }
    return replace(part, **cut)
