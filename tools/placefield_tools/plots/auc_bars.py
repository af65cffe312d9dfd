"""Picture of the AUC and the recall of several methods, as bars."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes

from placefield_tools.plots import style

_OTHERS = "#b4bcc4"


@dataclass(frozen=True, slots=True)
class AucBar:
    """The figures of one method.

    Attributes:
        name: of the method.
        auc: area under its precision-recall curve; None where it failed.
        recall: at 100 % precision; None where it failed.
        ours: whether the bar stands out from the others.

    """

    name: str
    auc: float | None
    recall: float | None
    ours: bool


def plot_auc_bars(path: Path, bars: Sequence[AucBar], title: str | None = None) -> None:
    """Draw one bar per method for its AUC and one for its recall at 100 % precision.

    After the AMS paper's figures 12(b) and 13(b), and for what its figures 16 and 17 compare.

    Args:
        path: the PNG file to write.
        bars: from top to bottom; a method that failed keeps its line, and the word instead of bars.
        title: printed above.

    Raises:
        OSError: the file cannot be written.

    """
    figure = style.new_figure(9, 0.9 + 0.32 * len(bars), title)
    auc, recall = figure.subplots(1, 2, sharey=True)
    _draw(auc, "AUC", bars, [bar.auc for bar in bars])
    _draw(recall, "Recall at 100 % precision", bars, [bar.recall for bar in bars])
    auc.set_yticks(range(len(bars)), [bar.name for bar in bars])
    auc.tick_params(axis="y", length=0, labelcolor=style.INK)
    auc.set_ylim(len(bars) - 0.4, -0.6)
    style.save(figure, path)


def _draw(axes: Axes, name: str, bars: Sequence[AucBar], values: Sequence[float | None]) -> None:
    for line, (bar, value) in enumerate(zip(bars, values, strict=True)):
        axes.barh(line, value or 0, 0.74, color=style.RIGHT if bar.ours else _OTHERS)
        text = "failed" if value is None else f"{value:.3f}"
        axes.annotate(
            text,
            (value or 0, line),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
            color=style.MUTED if value is None else style.INK,
            fontweight="bold" if bar.ours else "normal",
        )
    axes.set_title(name, loc="left", fontsize=10, color=style.INK)
    axes.set_xlim(0, 1)
    axes.grid(axis="x", color=style.FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    style.tidy(axes)
    axes.tick_params(axis="y", length=0)
