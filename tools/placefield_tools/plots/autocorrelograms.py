"""Picture of the scales of every channel, as autocorrelograms of cells that fire in its segments.

A grid cell fires in fields that repeat at a distance, its scale, so its autocorrelogram has a field
in the middle and others around it. In the plane these stand on a hexagonal lattice. A route has one
dimension, so here there is a line, with a field in the middle and others on either side.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from placefield_tools.plots import style
from placefield_tools.plots.runs import ChannelSegments, Runs, runs_of

_FIELDS = 6.0  # mean segments, of the channel with the longest, that a side shows


def plot_autocorrelograms(
    path: Path,
    channels: Sequence[ChannelSegments],
    most: int | None = None,
    title: str | None = None,
) -> None:
    """Draw the autocorrelogram of a cell of each channel, as a strip and as a line below it.

    The cell is that of `firing`. The strip is white where there is no correlation, red where it is
    positive and blue where it is negative; all channels share the abscissa, so that wider fields
    farther apart are a larger scale. After the AMS paper's figure 1, in the one dimension of a
    route: there is no hexagonal lattice.

    Args:
        path: the PNG file to write.
        channels: from top to bottom, at least one.
        most: the largest shift in places; None is six segments of the channel where they are
            longest, and half of the shortest channel's route at most.
        title: printed above.

    Raises:
        OSError: the file cannot be written.
        ValueError: there is no channel to draw, one has no place, or `most` does not fit in one.

    """
    if not channels:
        raise ValueError("there is no channel to draw")
    runs = [runs_of(channel) for channel in channels]
    shortest = min(len(channel.label) for channel in channels)
    if most is None:
        longest = max(_mean_length(run) for run in runs)
        most = min(max(round(_FIELDS * longest), 1), shortest // 2)
    figure = style.new_figure(9, 0.7 + 1.5 * len(channels), title)
    rows = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, channel, run in zip(rows, channels, runs, strict=True):
        _draw(axes, autocorrelation(firing(channel), most))
        strip = axes.inset_axes((0, 1.04, 1, 0.2), sharex=axes)
        _draw_strip(strip, autocorrelation(firing(channel), most))
        strip.set_title(_summary(channel, run), loc="left", fontsize=10, color=style.INK, pad=4)
        axes.set_xlim(-most - 0.5, most + 0.5)
    rows[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    rows[-1].set_xlabel("Shift (places)")
    style.save(figure, path)


def firing(channel: ChannelSegments) -> NDArray[np.float64]:
    """Give the rate of a cell that fires in every second active segment of a channel.

    Were it to fire in all of them, neighbouring segments would be one field.

    Returns:
        1 at the places of the first, third, fifth … active segment in route order, 0 at the
        others, (K,) float64.

    Raises:
        ValueError: the channel has no place, or not as many labels as it has active flags.

    """
    runs = runs_of(channel)
    fires = runs.active & (np.cumsum(runs.active) % 2 == 1)
    return np.repeat(fires, runs.length).astype(np.float64)


def autocorrelation(rate: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Correlate a rate with itself, shifted by every τ from -most to most places.

    Args:
        rate: of each place, (K,) float64.
        most: the largest shift, at least 0 and below K.

    Returns:
        Pearson's correlation over the places where both are there, by ascending τ,
        (2 most + 1,) float64: 1 at τ = 0, and 0 wherever one of the two does not vary.

    Raises:
        ValueError: `most` does not fit.

    """
    if not 0 <= most < len(rate):
        raise ValueError(f"a rate of {len(rate)} places cannot be shifted by {most}")
    side = [_correlation(rate[shift:], rate[: len(rate) - shift]) for shift in range(most + 1)]
    return np.array(side[:0:-1] + side)


def _correlation(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    if np.ptp(one) == 0 or np.ptp(other) == 0:
        return 0.0
    one, other = one - one.mean(), other - other.mean()
    return float((one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum()))


def _mean_length(run: Runs) -> float:
    return float(run.scales.mean()) if run.scales.size else 0.0


def _summary(channel: ChannelSegments, run: Runs) -> str:
    lengths = f", {_mean_length(run):.1f} frames long on average" if run.scales.size else ""
    return (
        f"{channel.name}   fuzzifier {channel.fuzzifier:.2f}   "
        f"{run.scales.size} active segments{lengths}"
    )


def _draw_strip(axes: Axes, correlation: NDArray[np.float64]) -> None:
    half = len(correlation) / 2
    axes.imshow(
        correlation[None],
        cmap="RdBu_r",
        vmin=-1,
        vmax=1,
        aspect="auto",
        interpolation="nearest",
        extent=(-half, half, 0, 1),
    )
    axes.set(yticks=[])
    axes.tick_params(axis="x", bottom=False, labelbottom=False)
    axes.spines[:].set(color=style.MUTED, linewidth=0.6)


def _draw(axes: Axes, correlation: NDArray[np.float64]) -> None:
    most = len(correlation) // 2
    axes.axhline(0, color=style.MUTED, linewidth=0.8)
    axes.plot(np.arange(-most, most + 1), correlation, color=style.INK, linewidth=1.6)
    axes.set(ylim=(-1, 1.02), yticks=[-1, 0, 1], ylabel="Correlation")
    axes.grid(axis="x", color=style.FAINT, linewidth=0.8)
    axes.set_axisbelow(True)
    style.tidy(axes)
