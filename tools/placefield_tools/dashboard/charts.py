"""The charts, as ECharts options. The greys are readable on light and dark backgrounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.maps.map import MapChannel

Options = dict[str, Any]

_TEXT = {"color": "#888"}
_AXIS = {"axisLabel": _TEXT, "nameTextStyle": _TEXT}
_RULED = {"splitLine": {"lineStyle": {"color": "#8886"}}}
_PLAIN = {"splitLine": {"show": False}}
_TONES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a8a8a")


def certainty_chart(precision: float) -> Options:
    """Return an empty chart of probabilities and score, see ``set_certainty``.

    Args:
        precision: the probability from which on a match is known; it is drawn as a line.
    """
    line = {"type": "line", "showSymbol": False, "data": []}
    asked = {
        "silent": True,
        "symbol": "none",
        "lineStyle": {"color": "#8a8a8a", "type": "dashed"},
        "label": {"formatter": f"{100 * precision:g} % asked", "position": "insideEndBottom"}
        | _TEXT,
        "data": [{"yAxis": precision}],
    }
    return _chart() | {
        "xAxis": {"type": "value", "min": "dataMin", "max": "dataMax"} | _AXIS | _PLAIN,
        "yAxis": [
            {"type": "value", "min": 0, "max": 1} | _AXIS | _RULED,
            {"type": "value", "scale": True} | _AXIS | _PLAIN,
        ],
        "series": [
            line | {"name": "at once", "color": "#2f8fd0", "markLine": asked},
            line | {"name": "smoothed", "color": "#009e73", "lineStyle": {"width": 1}},
            {"type": "scatter", "name": "not known", "symbolSize": 6, "color": "#e0782f"}
            | {"data": []},
            line
            | {"name": "score", "yAxisIndex": 1, "lineStyle": {"width": 1}, "color": "#8a8a8a"},
        ],
    }


def set_certainty(
    chart: Options,
    frames: Sequence[tuple[int, MatchMessage, SmoothedMessage | None]],
) -> None:
    """Put frames into that chart: number, first match, and smoothed match if it has come."""
    at_once, smoothed, unknown, score = chart["series"]
    rated = [
        (frame, match.probability, match.known)
        for frame, match, _ in frames
        if match.probability is not None
    ]
    at_once["data"] = [[frame, probability] for frame, probability, _ in rated]
    unknown["data"] = [[frame, probability] for frame, probability, known in rated if not known]
    smoothed["data"] = [
        [frame, later.probability]
        for frame, _, later in frames
        if later is not None and later.probability is not None
    ]
    score["data"] = [[frame, round(match.score, 3)] for frame, match, _ in frames]


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
