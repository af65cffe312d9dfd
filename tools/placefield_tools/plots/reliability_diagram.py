"""Reliability diagram: probabilities of matches against how often they are right."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, PercentFormatter
from numpy.typing import NDArray

from placefield.evaluation.reliability import Reliability
from placefield_tools.plots import style


def plot_reliability(path: Path, found: Reliability, title: str | None = None) -> None:
    """Draw the share of right matches over their probability, above the matches of each bin.

    A dot on the diagonal keeps its word; a stroke joins every other dot to where it should be.

    Args:
        path: the PNG file to write.
        found: the bins.
        title: printed above.

    Raises:
        OSError: the file cannot be written.

    """
    figure = style.new_figure(6.4, 6.6, title)
    diagram, histogram = figure.subplots(2, 1, sharex=True, height_ratios=[4, 1])
    _draw_diagram(diagram, found)
    _draw_counts(histogram, found.count)
    style.save(figure, path)


def _draw_diagram(axes: Axes, found: Reliability) -> None:
    axes.plot([0, 1], [0, 1], color=style.MUTED, linestyle=":", linewidth=1.5)
    axes.vlines(
        found.mean_probability,
        found.mean_probability,
        found.share_correct,
        color=style.WRONG,
        linewidth=2,
    )
    axes.plot(
        found.mean_probability,
        found.share_correct,
        "o",
        color=style.RIGHT,
        markersize=7,
        clip_on=False,
        zorder=3,
    )
    error = found.expected_calibration_error
    axes.set_title(
        f"Expected calibration error {error:.3f}", loc="left", fontsize=10, color=style.INK
    )
    axes.set(xlim=(0, 1), ylim=(0, 1), ylabel="Right matches")
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.grid(color=style.FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    style.tidy(axes)


def _draw_counts(axes: Axes, count: NDArray[np.int64]) -> None:
    width = 1 / len(count)
    left = np.arange(len(count)) * width
    axes.bar(left, count, 0.92 * width, align="edge", color=style.RIGHT, alpha=0.6)
    axes.set(xlabel="Probability that the match is right", ylabel="Matches")
    axes.xaxis.set_major_formatter(PercentFormatter(1))
    axes.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    style.tidy(axes)
