from dataclasses import replace

import numpy as np
import pytest

from placefield.maps.map import Map
from placefield.maps.map_metrics import with_looks
from placefield.matching.comparing import MetricPlaces
from placefield_tools.dashboard import distance_columns
from placefield_tools.dashboard.distance_columns import DistanceColumns


@pytest.mark.parametrize("most", [4096, 20])
def test_columns_have_the_distances_of_places_and_their_looks(
    route_map: Map, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(distance_columns, "_MOST_PLACES", most)
    metric = route_map.metrics[0]
    shown = np.arange(10, 40, dtype=np.int32)
    looked = with_looks(metric, shown, metric.places[shown[::-1]])
    channels = tuple(replace(channel, metric=looked) for channel in route_map.channels)
    columns = DistanceColumns(replace(route_map, channels=channels))
    descriptor = (metric.places[12] * metric.unit).astype(np.float32)
    (frame,) = MetricPlaces(looked, exact=True).compare(descriptor[None])
    expected = frame.distances[:: -(-60 // most)] * metric.unit**2
    np.testing.assert_allclose(columns.row(descriptor), expected, rtol=1e-6)
