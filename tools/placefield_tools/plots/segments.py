"""Picture of the segments and scales of every channel."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from placefield_tools.plots import style
from placefield_tools.plots.runs import (
    ACTIVE,
    ChannelSegments,
    Runs,
    draw_bar,
    runs_of,
    summary,
)

_MOST_BINS = 40


def plot_segments(path: Path, channels: Sequence[ChannelSegments], places: int) -> None:
    """Draw, per channel, its segments as a bar, their labels as a staircase, and its scales.

    Active segments are red, in two tones in turn; inactive ones are blue. The histogram at the
    right counts the active segments by length. After the AMS paper's figures 5, 7 and 11.

    Args:
        path: the PNG file to write.
        channels: from top to bottom, at least one.
        places: number of places of the map, K.

    Raises:
        OSError: the file cannot be written.
        ValueError: there is no channel to draw.

    """
    if not channels:
        raise ValueError("there is no channel to draw")
    runs = [runs_of(channel) for channel in channels]
    bins = _bins([run.scales for run in runs])
    figure = style.new_figure(
        11, 0.8 + 1.8 * len(channels), "Segments and scales: active red, inactive blue"
    )
    grid = figure.subplots(
        len(channels), 2, sharex="col", sharey="col", width_ratios=[4, 1], squeeze=False
    )
    for (staircase, histogram), channel, run in zip(grid, channels, runs, strict=True):
        _draw_staircase(staircase, run, places)
        bar = staircase.inset_axes((0, 1.04, 1, 0.14), sharex=staircase)
        draw_bar(bar, run)
        bar.set_title(summary(channel, run), loc="left", fontsize=10, color=style.INK, pad=4)
        histogram.hist(run.scales, bins=bins, color=ACTIVE[0], rwidth=0.85)
        histogram.yaxis.set_major_locator(MaxNLocator(3, integer=True))
        style.tidy(histogram)
    grid[0, 1].set_title("Segments per scale", loc="left", fontsize=10, color=style.INK)
    grid[-1, 0].set_xlabel("Place")
    grid[-1, 1].set_xlabel("Scale (frames)")
    style.save(figure, path)


def _bins(scales: list[NDArray[np.intp]]) -> NDArray[np.float64]:
    """Edges of at most `_MOST_BINS` bins of equal whole width over all channels' scales."""
    longest = int(np.concatenate(scales).max(initial=1))
    width = -(-longest // _MOST_BINS)
    return np.arange(0.5, longest + width + 0.5, width)


def _draw_staircase(axes: Axes, run: Runs, places: int) -> None:
    axes.hlines(run.label, run.start, run.start + run.length, colors=run.colours, linewidth=3)
    axes.set(xlim=(0, places), ylabel="Label")
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    style.tidy(axes)
