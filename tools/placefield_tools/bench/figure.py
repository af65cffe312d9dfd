"""The figures of a benchmark, as a table and as JSON."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True)
class Figure:
    """One number that was measured.

    Attributes:
        key: its name in JSON; ends in its unit where it has one, as ``_ms``.
        value: the number.
        what: it is, in a few words.
        at_least: the bar that it is held to from below, if any.
        at_most: the bar that it is held to from above, if any.
    """

    key: str
    value: float
    what: str
    at_least: float | None = None
    at_most: float | None = None

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
    """Return the numbers by their keys.

    Raises:
        ValueError: two have the same key.
    """
    numbers = {figure.key: figure.value for figure in figures}
    if len(numbers) < len(figures):
        raise ValueError("two figures have the same key")
    return numbers


def print_figures(title: str, figures: Sequence[Figure]) -> None:
    """Print a table of what was measured beside the bars."""
    table = Table(title=title, caption="No bar: for comparison only.")
    table.add_column("figure", overflow="fold")
    for header in ("measured", "bar", "met"):
        table.add_column(header, justify="right", no_wrap=True)
    for figure in figures:
        met = ("yes" if figure.is_met else "no") if figure.bar else ""
        what = f"{figure.key}\n  {figure.what}"
        table.add_row(what, f"{figure.value:.4g}", figure.bar, met)
    Console(markup=False).print(table)
