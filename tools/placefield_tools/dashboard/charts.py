"""The charts, as ECharts options. The greys are readable on light and dark backgrounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from placefield.maps.map import MapChannel

Options = dict[str, Any]

_TEXT = {"color": "#888"}
_AXIS = {"axisLabel": _TEXT, "nameTextStyle": _TEXT}
_RULED = {"splitLine": {"lineStyle": {"color": "#8886"}}}
_PLAIN = {"splitLine": {"show": False}}
_TONES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a8a8a")


def scales_chart(channels: Sequence[MapChannel]) -> Options:
    """Return how many segments of each length each channel has."""
    lengths = [np.diff(channel.segments, axis=1)[:, 0] for channel in channels]
    longest = max((int(some.max(initial=1)) for some in lengths), default=1)
    series = [
        {
            "name": f"channel {number}",
            "type": "bar",
            "stack": "all",
            "color": _TONES[number % len(_TONES)],
            "data": np.bincount(some, minlength=longest + 1)[1:].tolist(),
        }
        for number, some in enumerate(lengths)
    ]
    return _chart() | {
        "xAxis": {"type": "category", "data": list(range(1, longest + 1))} | _AXIS,
        "yAxis": {"type": "value"} | _AXIS | _RULED,
        "series": series,
    }


def curves_chart(channels: Sequence[MapChannel]) -> Options | None:
    """Return validation loss and gate score of each channel by step, if any learned."""
    series = [
        {
            "name": f"channel {number}, {what}",
            "type": "line",
            "yAxisIndex": axis,
            "color": _TONES[number % len(_TONES)],
            "lineStyle": {"type": "dashed" if axis else "solid"},
            "data": channel.curve[:, axis].tolist(),
        }
        for number, channel in enumerate(channels)
        for axis, what in enumerate(("loss", "gate"))
        if len(channel.curve)
    ]
    if not series:
        return None
    steps = max(len(channel.curve) for channel in channels)
    value = {"type": "value", "scale": True} | _AXIS
    return _chart() | {
        "xAxis": {"type": "category", "data": list(range(steps))} | _AXIS,
        "yAxis": [value | _RULED, value | _PLAIN],
        "series": series,
    }


def _chart() -> Options:
    return {
        "animation": False,
        "grid": {"left": 48, "right": 48, "top": 36, "bottom": 26},
        "legend": {"type": "scroll", "textStyle": _TEXT, "top": 0},
        "tooltip": {"trigger": "axis"},
    }
