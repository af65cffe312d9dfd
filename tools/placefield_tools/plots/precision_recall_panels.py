"""Picture of precision over recall of many methods, a panel for each."""

from collections.abc import Collection, Mapping
from pathlib import Path
from textwrap import fill

from matplotlib.axes import Axes

from placefield.evaluation.curves import PrecisionRecall
from placefield_tools.plots import style

_COLUMNS = 5
_NAME_WIDTH = 17  # characters that fit over a panel
_OTHERS = "#d3d8dc"


def plot_precision_recall_panels(
    path: Path, curves: Mapping[str, PrecisionRecall], ours: Collection[str]
) -> None:
    """Draw each curve in a panel of its own, over all the others in grey.

    More than a handful of curves cannot be told apart in one frame. A dot marks the recall at
    100 % precision. After the AMS paper's figures 12(a) and 13(a).

    Args:
        path: the PNG file to write.
        curves: by name, at least one, in reading order.
        ours: names of the curves that stand out in colour.

    Raises:
        OSError: the file cannot be written.

    """
    rows = -(-len(curves) // _COLUMNS)
    figure = style.new_figure(9, 0.4 + 2 * rows)
    for panel, (name, curve) in enumerate(curves.items(), start=1):
        axes = figure.add_subplot(rows, _COLUMNS, panel, aspect="equal")
        for other in curves.values():
            axes.plot(other.recall, other.precision, color=_OTHERS, linewidth=0.8)
        _draw(axes, name, curve, style.RIGHT if name in ours else style.INK)
    figure.supxlabel("Recall", fontsize=10, color=style.INK)
    figure.supylabel("Precision", fontsize=10, color=style.INK)
    style.save(figure, path)


def _draw(axes: Axes, name: str, curve: PrecisionRecall, colour: str) -> None:
    perfect = curve.recall_at_100_precision
    axes.plot(curve.recall, curve.precision, color=colour, linewidth=2, clip_on=False)
    axes.plot(perfect, 1, "o", color=colour, mec="white", clip_on=False, zorder=3)
    text = f"AUC {curve.auc:.3f}\nR@100P {perfect:.3f}"
    axes.text(0.98, 0.04, text, ha="right", fontsize=9, color=colour)
    axes.set_title(fill(name, _NAME_WIDTH), loc="left", fontsize=9, color=colour)
    axes.set(xlim=(0, 1), ylim=(0, 1), xticks=[0, 0.5, 1], yticks=[0, 0.5, 1])
    style.tidy(axes)
