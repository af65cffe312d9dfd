"""The figures of a benchmark, as a table and as JSON."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from placefield_tools.bench.ratio import Ratio


@dataclass(frozen=True)
class Figure:
    """One number that was measured.

    Attributes:
        key: its name in JSON; ends in its unit where it has one, as ``_ms``.
        measured: the number; a ratio of ways that took turns has an interval.
        what: it is, in a few words.
        at_least: the bar that it is held to from below, if any.
        at_most: the bar that it is held to from above, if any.
    """

    key: str
    measured: float | Ratio
    what: str
    at_least: float | None = None
    at_most: float | None = None

    @property
    def value(self) -> float:
        """The number."""
        return self.measured.value if isinstance(self.measured, Ratio) else self.measured

    @property
    def interval(self) -> str:
        """The 95 % interval as one writes it; empty where the number is no ratio."""
        if not isinstance(self.measured, Ratio):
            return ""
        if math.isnan(self.measured.low):
            return "too few rounds"
        written = f"{self.measured.low:.4g} to {self.measured.high:.4g}"
        return written if self.measured.is_narrow else f"{written}, wide"

    @property
    def bar(self) -> str:
        """The bar as one writes it; empty where there is none."""
        if self.at_least is not None:
            return f"≥ {self.at_least:g}"
        return f"≤ {self.at_most:g}" if self.at_most is not None else ""

    @property
    def is_met(self) -> bool:
        """Whether the bar is met, if there is one; a value that is no number meets none."""
        low = -float("inf") if self.at_least is None else self.at_least
        high = float("inf") if self.at_most is None else self.at_most
        return low <= self.value <= high or not self.bar


def as_object(figures: Sequence[Figure]) -> dict[str, float]:
    """Return the numbers by their keys; ends of intervals have keys in ``_low`` and ``_high``.

    A ratio of too few rounds has no such ends.

    Raises:
        ValueError: two have the same key.
    """
    numbers: dict[str, float] = {}
    for figure in figures:
        for key, number in _numbers_of(figure):
            if key in numbers:
                raise ValueError(f"two figures have the same key {key}")
            numbers[key] = number
    return numbers


def _numbers_of(figure: Figure) -> Iterator[tuple[str, float]]:
    yield figure.key, figure.value
    ratio = figure.measured
    if isinstance(ratio, Ratio) and not math.isnan(ratio.low):
        yield f"{figure.key}_low", ratio.low
        yield f"{figure.key}_high", ratio.high


def print_figures(title: str, figures: Sequence[Figure]) -> None:
    """Print a table of what was measured beside the bars."""
    caption = "No bar: for comparison only. Wide: the 95 % interval is 10 % of the ratio or more."
    table = Table(title=title, caption=caption)
    table.add_column("figure", overflow="fold")
    for header in ("measured", "bar", "met"):
        table.add_column(header, justify="right", no_wrap=True)
    for figure in figures:
        met = ("yes" if figure.is_met else "no") if figure.bar else ""
        what = f"{figure.key}\n  {figure.what}"
        measured = f"{figure.value:.4g}\n{figure.interval}"
        table.add_row(what, measured, figure.bar, met)
    Console(markup=False).print(table)
