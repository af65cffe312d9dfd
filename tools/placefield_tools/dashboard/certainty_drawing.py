"""The drawing of how certain the last answers were, as the inside of an SVG element.

It changes ten times a second. A chart of ECharts took 21 ms of the browser for each change, more
than the 16.7 ms between two pictures of the screen; this takes about one.
"""

from collections.abc import Sequence

from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield_tools.dashboard.marks import marks_drawing
from placefield_tools.dashboard.verdict import kind_of

HEIGHT = 100
_MARGIN = 3  # above certainty, and below impossibility

Drawn = tuple[int, MatchMessage, SmoothedMessage | None]
"""Column of a frame, its first match, and its smoothed match if it has come."""


def certainty_drawing(frames: Sequence[Drawn], columns: int, precision: float) -> str:
    """Draw probabilities, the one that is asked for, and scores between their extremes.

    Args:
        frames: what was answered, in the order of the columns.
        columns: units that the drawing is wide; it is ``HEIGHT`` units high.
        precision: the probability from which on a match is known.
    """
    rated = [
        (column, match.probability, kind_of(match))
        for column, match, _ in frames
        if match.probability is not None
    ]
    later = [
        (column, match.probability)
        for column, _, match in frames
        if match is not None and match.probability is not None
    ]
    marks = [
        (column + 0.5, _height(share), kind)
        for column, share, kind in rated
        if kind in ("likely", "unknown")
    ]
    return "".join(
        [
            f'<path class="asked" d="M0 {_height(precision):.1f}H{columns}"/>',
            _line("score", _scores(frames)),
            _line("smoothed", later),
            _line("at-once", [(column, share) for column, share, _ in rated]),
            marks_drawing(marks),
        ]
    )


def score_range(frames: Sequence[Drawn]) -> tuple[float, float] | None:
    """Return the lowest and the highest score; None without frames."""
    scores = [match.score for _, match, _ in frames]
    return (min(scores), max(scores)) if scores else None


def _scores(frames: Sequence[Drawn]) -> list[tuple[int, float]]:
    """Return the scores by column, from 0 for the lowest to 1 for the highest."""
    extremes = score_range(frames)
    if extremes is None:
        return []
    lowest, highest = extremes
    extent = (highest - lowest) or 1.0
    return [(column, (match.score - lowest) / extent) for column, match, _ in frames]


def _line(kind: str, shares: Sequence[tuple[int, float]]) -> str:
    points = "L".join(f"{column + 0.5:g} {_height(share):.1f}" for column, share in shares)
    return f'<path class="{kind}" d="M{points}"/>' if points else ""


def _height(share: float) -> float:
    return _MARGIN + (1 - share) * (HEIGHT - 2 * _MARGIN)
