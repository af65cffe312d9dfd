"""Picture of precision over recall."""

from collections.abc import Mapping
from pathlib import Path

from placefield.evaluation.curves import PrecisionRecall
from placefield_tools.plots import style

# Okabe and Ito's palette, without its yellow, which is lost on white.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
_DASHES = ("-", "--", ":", "-.")


def plot_precision_recall(path: Path, curves: Mapping[str, PrecisionRecall], title: str) -> None:
    """Draw the curves, each with its AUC and its recall at 100 % precision (a dot) in the legend.

    Args:
        path: the PNG file to write.
        curves: by name, in the order of the legend.
        title: printed above.

    Raises:
        OSError: the file cannot be written.

    """
    figure = style.new_figure(7.6, max(5.0, 1.0 + 0.45 * len(curves)), title)
    axes = figure.add_subplot(aspect="equal", anchor="NW")
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="Recall", ylabel="Precision")
    axes.grid(color=style.FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    style.tidy(axes)

    for index, (name, curve) in enumerate(curves.items()):
        colour = _COLOURS[index % len(_COLOURS)]
        perfect = curve.recall_at_100_precision
        axes.plot(
            curve.recall,
            curve.precision,
            color=colour,
            linestyle=_DASHES[index // len(_COLOURS) % len(_DASHES)],
            linewidth=2,
            clip_on=False,
            label=f"{name}\nAUC {curve.auc:.3f}   R@100P {perfect:.3f}",
        )
        axes.plot(perfect, 1, "o", color=colour, mec="white", clip_on=False, zorder=3)
    axes.legend(
        loc="upper left",
        bbox_to_anchor=(1.02, 1.02),
        frameon=False,
        fontsize=9.5,
        labelcolor=style.INK,
        labelspacing=0.9,
    )
    style.save(figure, path)
