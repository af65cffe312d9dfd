"""Filters of the places of a metric, for tests of what they come to believe."""

from placefield.maps.map import MapMetric
from placefield.matching.channel_matcher import _jumps
from placefield.matching.comparing import Comparison
from placefield.matching.place_filter import PlaceFilter


def filter_of(metric: MapMetric, persistence: float) -> PlaceFilter:
    return PlaceFilter(metric.steps, _jumps(metric), persistence)


def push(place_filter: PlaceFilter, frame: Comparison | None) -> None:
    if frame is None:
        place_filter.push_unseen()
    else:
        place_filter.push(frame)
