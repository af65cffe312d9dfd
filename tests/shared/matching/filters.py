"""Filters of the places of a metric, for tests of what they come to believe."""

from placefield.maps.map import MapMetric
from placefield.matching.comparing import Comparison
from placefield.matching.filter_matcher import jumps_of
from placefield.matching.place_filter import PlaceFilter


def filter_of(metric: MapMetric, persistence: float) -> PlaceFilter:
    """A filter of all places, which are the only shard."""
    return PlaceFilter(metric.steps, jumps_of(metric), persistence, slice(0, len(metric.places)))


def push(place_filter: PlaceFilter, frame: Comparison | None) -> None:
    share = place_filter.take_unseen() if frame is None else place_filter.take(frame)
    place_filter.settle([share], 0)
