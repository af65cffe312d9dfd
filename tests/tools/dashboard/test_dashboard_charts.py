from dataclasses import replace

import numpy as np

from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map
from placefield_tools.dashboard.charts import (
    certainty_chart,
    curves_chart,
    scales_chart,
    set_certainty,
)


def test_certainty_shows_both_answers_the_score_and_the_threshold() -> None:
    chart = certainty_chart(0.99)
    of_map = {"map": NO_DIGEST, "place": 1}
    frames = [
        (0, MatchMessage(**of_map, score=-1.0, probability=0.25, known=False), None),
        (
            1,
            MatchMessage(**of_map, score=2.0, probability=0.995, known=True),
            SmoothedMessage(**of_map, score=3.0, probability=0.999, known=True, lag=4),
        ),
        (2, MatchMessage(**of_map, score=3.0), None),
    ]
    set_certainty(chart, frames)
    data = {series["name"]: series["data"] for series in chart["series"]}
    assert data == {
        "at once": [[0, 0.25], [1, 0.995]],
        "smoothed": [[1, 0.999]],
        "not known": [[0, 0.25]],
        "score": [[0, -1.0], [1, 2.0], [2, 3.0]],
    }
    [threshold] = chart["series"][0]["markLine"]["data"]
    assert threshold == {"yAxis": 0.99}
    assert all(not series["data"] for series in certainty_chart(0.99)["series"])


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
