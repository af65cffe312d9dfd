"""Picture of what combining more channels brings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from placefield_tools.plots import style

_COLOURS = (style.RIGHT, style.WRONG, "#009e73")


@dataclass(frozen=True, slots=True, eq=False)
class ChannelCount:
    """How combinations of so many channels did.

    Attributes:
        name: of the line that they belong to.
        channels: how many are combined.
        auc: of each combination, (C,) float64, C at least 1.
        recall: of each combination at 100 % precision, (C,) float64.

    """

    name: str
    channels: int
    auc: NDArray[np.float64]
    recall: NDArray[np.float64]


def plot_channel_counts(
    path: Path, counts: Sequence[ChannelCount], title: str | None = None
) -> None:
    """Draw mean and standard deviation of AUC and recall over the number of combined channels.

    After the AMS paper's figures 18 to 20. The ordinates begin below the worst combination.

    Args:
        path: the PNG file to write.
        counts: by ascending number of channels, of one line or more; at least one.
        title: printed above.

    Raises:
        OSError: the file cannot be written.

    """
    figure = style.new_figure(9, 4.2, title)
    auc, recall = figure.subplots(1, 2)
    _draw(auc, "AUC", counts, lambda count: count.auc)
    _draw(recall, "Recall at 100 % precision", counts, lambda count: count.recall)
    handles, names = auc.get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside lower center",
        ncols=len(handles),
        frameon=False,
        fontsize=10,
        labelcolor=style.INK,
    )
    style.save(figure, path)


def _draw(
    axes: Axes,
    name: str,
    counts: Sequence[ChannelCount],
    values: Callable[[ChannelCount], NDArray[np.float64]],
) -> None:
    lines = list(dict.fromkeys(count.name for count in counts))
    for index, line in enumerate(lines):
        of_line = [count for count in counts if count.name == line]
        # Beside one another, for error bars on one abscissa would hide each other.
        aside = 0.16 * (index - (len(lines) - 1) / 2)
        axes.errorbar(
            [count.channels + aside for count in of_line],
            [values(count).mean() for count in of_line],
            [values(count).std() for count in of_line],
            color=_COLOURS[index % len(_COLOURS)],
            marker="o",
            markersize=5,
            linewidth=1.8,
            elinewidth=1.2,
            capsize=3,
            clip_on=False,
            label=line,
        )
    most = max(count.channels for count in counts)
    axes.set(xlim=(0.5, most + 0.5), ylim=(_bottom(counts, values), 1.02))
    axes.set_xlabel("Combined channels")
    axes.set_title(name, loc="left", fontsize=10, color=style.INK)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.grid(axis="y", color=style.FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    style.tidy(axes)


def _bottom(
    counts: Sequence[ChannelCount], values: Callable[[ChannelCount], NDArray[np.float64]]
) -> float:
    """Give the multiple of 0.1 that lies clearly below every mean and its deviation."""
    lowest = min(values(count).mean() - values(count).std() for count in counts)
    return float(np.clip(np.floor(10 * lowest - 0.5) / 10, 0, 0.8))
