from dataclasses import replace

import numpy as np

from placefield.maps.map import Map
from placefield_tools.dashboard.charts import (
    curves_chart,
    scales_chart,
)


def test_every_segment_is_counted_at_its_scale(route_map: Map) -> None:
    chart = scales_chart(route_map.channels)
    for channel, series in zip(route_map.channels, chart["series"], strict=True):
        assert sum(series["data"]) == len(channel.segments)
        counted = [
            scale for scale, n in zip(chart["xAxis"]["data"], series["data"], strict=True) if n
        ]
        assert counted == channel.scales.tolist()


def test_curves_are_those_of_the_channels_that_learned(route_map: Map) -> None:
    assert curves_chart(route_map.channels) is None
    [first, second, *_] = route_map.channels
    curve = np.array([[1.0, 0.2], [0.5, 0.3], [0.4, 0.4]])
    chart = curves_chart([first, replace(second, curve=curve)])
    assert chart is not None
    assert [series["name"] for series in chart["series"]] == ["channel 1, loss", "channel 1, gate"]
    assert [series["data"] for series in chart["series"]] == curve.T.tolist()
