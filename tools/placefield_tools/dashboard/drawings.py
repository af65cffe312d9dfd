"""Drawings as the insides of SVG elements; the page's style colours them by their classes.

They contain numbers only, so that no text of an untrusted client reaches the page.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.config import Rule
from placefield.maps.map import MapChannel
from placefield.matching.candidate import Candidate
from placefield_tools.dashboard.fields import Window, firing_segment, heights
from placefield_tools.dashboard.verdict import Kind

FIELD_HEIGHT = 56
_BASE, _TOP, _BAR = (
    18,
    4,
    4,
)  # in parts of the height: below the segments, above them, and of each bar
_BINS = 200  # of the evidence

_MOST_POINTS = 2000  # of a route
_LEAST_BELIEF = 0.01  # that is drawn
_CROSS = "m-16 -16l32 32m0 -32l-32 32"
_MOST_BELIEF = 70.0  # units that certainty is high


def segments_drawing(channel: MapChannel, window: Window) -> str:
    """Draw a channel's segments over a window of places: the longer its scale, the higher.

    A unit is a place to the right, and a ``FIELD_HEIGHT``th of the height downwards.
    """
    inside = (channel.segments[:, 1] > window.first) & (channel.segments[:, 0] < window.end)
    bars = [_bar(channel, number, window) for number in np.flatnonzero(inside).tolist()]
    return "".join(bars)


def _bar(channel: MapChannel, number: int, window: Window) -> str:
    first, end = map(int, channel.segments[number])
    left, right = max(first, window.first), min(end, window.end)
    return _rectangle(
        "segment-a" if number % 2 else "segment-b",
        left - window.first,
        _height_of(channel, end - first),
        right - left,
        _BAR,
    )


def _height_of(channel: MapChannel, scale: int) -> float:
    """Return the height of the bar of a segment of this scale."""
    least, most = int(channel.scales[0]), int(channel.scales[-1])
    share = (scale - least) / (most - least) if most > least else 1.0
    return _TOP + (1 - share) * (FIELD_HEIGHT - _BASE - _TOP - _BAR)


def firing_drawing(
    channel: MapChannel, candidate: Candidate, rule: Rule | None, window: Window
) -> str:
    """Draw a channel's evidence and active segment over that."""
    drawn = []
    if fires := firing_segment(channel, candidate.place):
        first, end = fires
        left, right = max(first, window.first), min(end, window.end)
        if left < right:
            at = left - window.first
            drawn.append(_rectangle("field", at, 0, right - left, FIELD_HEIGHT))
            height = _height_of(channel, end - first)
            drawn.append(_rectangle("firing", at, height - 1, right - left, _BAR + 2))
    drawn.append(_evidence(heights(candidate, rule, window, _BINS), window))
    if window.first <= candidate.place < window.end:
        drawn.append(_upright("candidate", candidate.place - window.first + 0.5))
    return "".join(drawn)


def _evidence(found: NDArray[np.float64], window: Window) -> str:
    unit = window.size / len(found)
    steps = "".join(
        f"M{(part + 0.5) * unit:.2f} {FIELD_HEIGHT}V{FIELD_HEIGHT - max(height * _BASE, 1):.1f}"
        for part, height in enumerate(found)
        if height > 0
    )
    return f'<path class="evidence" d="{steps}"/>' if steps else ""


def match_drawing(place: int, window: Window) -> str:
    """Draw the match."""
    if not window.first <= place < window.end:
        return ""
    return _upright("match", place - window.first + 0.5)


def _rectangle(name: str, x: float, y: float, width: float, height: float) -> str:
    return f'<rect class="{name}" x="{x:g}" y="{y:.4g}" width="{width:g}" height="{height:g}"/>'


def _upright(name: str, x: float) -> str:
    return f'<path class="{name}" d="M{x:g} 0V{FIELD_HEIGHT}"/>'


def column_drawing(column: int, height: int) -> str:
    """Draw the column that is looked at, a unit wide, in a drawing that is so many units high."""
    return f'<path class="column" d="M{column + 0.5:g} 0V{height}"/>'


@dataclass(frozen=True)
class RouteDrawing:
    """A route drawn from above; without poses it is a line.

    Attributes:
        width: of the drawing, units.
        height: of it.
        inside: the route, and a bar that is ``bar_m`` long.
        bar_m: metres; 0 where the route has no poses.
    """

    width: float
    height: float
    inside: str
    bar_m: float
    _points: NDArray[np.float64]
    _yaws: NDArray[np.float64] | None

    @classmethod
    def of(cls, poses: NDArray[np.float64], count: int) -> "RouteDrawing":
        """Draw a route of so many places, with poses (count, 3) in metres and radians, or none.

        Where poses are NaN the line is broken.
        """
        width, margin = 1000.0, 40.0
        if not np.isfinite(poses).all(axis=1).any():
            points = np.column_stack(
                [np.linspace(margin, width - margin, count), np.full(count, 100.0)]
            )
            return cls(width, 130.0, _line(points), 0.0, points, None)
        poses = np.where(np.isfinite(poses).all(axis=1, keepdims=True), poses, np.nan)
        least, most = np.nanmin(poses[:, :2], axis=0), np.nanmax(poses[:, :2], axis=0)
        extent = np.maximum(most - least, 1e-3)
        scale = min((width - 2 * margin) / extent[0], (600.0 - 2 * margin) / extent[1])
        height = max(extent[1] * scale + 2 * margin, 220.0)
        middle = (least + most) / 2
        points = (poses[:, :2] - middle) * (scale, -scale) + (width / 2, height / 2)
        bar_m = _round_length(0.25 * width / scale)
        bar = f'<path class="bar" d="M{margin} {height - 16}h{bar_m * scale:.1f}"/>'
        return cls(width, height, _line(points) + bar, bar_m, points, poses[:, 2])

    def match(self, place: int, recent: Sequence[int], kind: Kind) -> str:
        """Draw the match by its kind, and the places of the matches before it, if they are known.

        An unknown match is a cross; the others have the direction of the route there.
        """
        passed = (f"M{x:.1f} {y:.1f}h0" for x, y in self._points[list(recent)] if not np.isnan(x))
        trail = "".join(dict.fromkeys(passed))  # each point once: most are the same on a long route
        x, y = self._points[place]
        drawn = f'<path class="trail" d="{trail}"/>'
        if np.isnan(x):
            return drawn
        if kind == "unknown":
            return f'{drawn}<path class="here unknown" d="M{x:.1f} {y:.1f}{_CROSS}"/>'
        if self._yaws is not None:
            turn = -np.degrees(self._yaws[place])
            drawn += (
                f'<path class="heading {kind}" d="M36 0L14 -13L14 13Z" '
                f'transform="translate({x:.1f} {y:.1f}) rotate({turn:.1f})"/>'
            )
        return f'{drawn}<circle class="here {kind}" cx="{x:.1f}" cy="{y:.1f}" r="13"/>'

    def belief(self, places: NDArray[np.int32], beliefs: NDArray[np.float64]) -> str:
        """Draw the belief in each place: a line beside the route, the longer the likelier."""
        likely = (beliefs >= _LEAST_BELIEF) & (places < len(self._points))
        lines = "".join(
            f"M{x:.1f} {y:.1f}v{-_MOST_BELIEF * belief:.1f}"
            for (x, y), belief in zip(self._points[places[likely]], beliefs[likely], strict=True)
            if not np.isnan(x)
        )
        return f'<path class="belief" d="{lines}"/>' if lines else ""

    def nearest(self, x: float, y: float) -> int | None:
        """Return the place nearest to a point of the drawing; None if no place has a pose."""
        apart = np.hypot(*(self._points - (x, y)).T)
        return None if np.isnan(apart).all() else int(np.nanargmin(apart))


def _line(points: NDArray[np.float64]) -> str:
    some = points[:: -(-len(points) // _MOST_POINTS)]
    drawn, pen = "", "M"
    for x, y in some:
        if np.isnan(x):
            pen = "M"
            continue
        drawn += f"{pen}{x:.1f} {y:.1f}"
        pen = "L"
    return f'<path class="route" d="{drawn}"/>'


def _round_length(metres: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not longer."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(max(power * step for step in (1, 2, 5) if power * step <= metres))
