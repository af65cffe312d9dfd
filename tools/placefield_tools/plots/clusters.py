"""Picture of some of a channel's segments, with frames from each."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from placefield_tools.plots import style
from placefield_tools.plots.frame_pictures import (
    PictureOf,
    draw_picture,
    height_per_width,
    read_pictures,
)
from placefield_tools.plots.runs import ChannelSegments, Runs, draw_bar, runs_of, summary

_SEGMENTS = 6
_FRAMES = 5
_WIDTH = 10.0
_BAR_HEIGHT = 0.9

# In inches, as is everything in the axes of the samples.
_TEXT_WIDTH = 1.3
_PICTURE_WIDTH = 1.62
_GAP = 0.06
_CAPTION = 0.24


def plot_clusters(
    path: Path, channel: ChannelSegments, picture_of: PictureOf, title: str | None = None
) -> None:
    """Draw the route as a bar, and below it what some of its active segments look like.

    There are at most six segments, of different lengths, in route order (`sample_segments`). Each
    has a letter, which stands under the bar too, its length in frames in a circle, its first and
    last place, and up to five frames from the first to the last. After the AMS paper's figures 5
    and 11.

    Args:
        path: the PNG file to write.
        channel: what to draw; of a channel without active segments there is only the bar.
        picture_of: gives the frame of a place, (H, W) grey or (H, W, 3) BGR, uint8.
        title: printed above.

    Raises:
        OSError: the file cannot be written.
        ValueError: the channel has no place, or a frame is not a picture.

    """
    runs = runs_of(channel)
    segments = sample_segments(runs, _SEGMENTS)
    places = [sample_places(int(runs.start[run]), int(runs.length[run])) for run in segments]
    pictures = read_pictures(picture_of, np.concatenate([[], *places]).astype(int).tolist())

    if not segments:
        figure = style.new_figure(_WIDTH, _BAR_HEIGHT + 0.4, title)
        _draw_route(figure.add_subplot(), channel, runs, segments)
        style.save(figure, path)
        return
    row = _PICTURE_WIDTH * height_per_width(pictures.values()) + _CAPTION
    samples_height = row * len(segments)
    figure = style.new_figure(_WIDTH, _BAR_HEIGHT + samples_height + 0.6, title)
    route, samples = figure.subplots(2, 1, height_ratios=[0.3, samples_height])
    _draw_route(route, channel, runs, segments)
    for line, (run, frames) in enumerate(zip(segments, places, strict=True)):
        _draw_segment(samples, runs, run, line, top=line * row, height=row - _CAPTION)
        for column, place in enumerate(frames.tolist()):
            left = _TEXT_WIDTH + column * (_PICTURE_WIDTH + _GAP)
            draw_picture(samples, pictures[place], left, line * row, _PICTURE_WIDTH)
            bottom = line * row + row - _CAPTION + 0.03
            samples.text(left, bottom, str(place), va="top", fontsize=8, color=style.MUTED)
    width = _TEXT_WIDTH + _FRAMES * (_PICTURE_WIDTH + _GAP)
    samples.set(xlim=(0, width), ylim=(samples_height, -0.05), aspect="equal", anchor="NW")
    samples.set_axis_off()
    style.save(figure, path)


def sample_segments(runs: Runs, most: int) -> list[int]:
    """Choose active segments of different lengths, spread over the route.

    For each of `most` lengths, evenly from the shortest to the longest, the segment whose length
    comes nearest is chosen; of several, the one farthest from those chosen before it, then the
    earliest.

    Args:
        runs: of the channel.
        most: how many to choose; all, where there are no more.

    Returns:
        Indices of the runs, in route order.

    """
    active = np.flatnonzero(runs.active)
    if not active.size:
        return []
    count = min(most, active.size)
    middle = runs.start + runs.length / 2
    chosen: list[int] = []
    for wanted in np.linspace(runs.scales.min(), runs.scales.max(), count):
        left = np.setdiff1d(active, chosen)
        off = np.abs(runs.length[left] - wanted)
        fitting = left[off == off.min()]
        aside = [min((abs(middle[run] - middle[c]) for c in chosen), default=0) for run in fitting]
        chosen.append(int(fitting[np.argmax(aside)]))
    return sorted(chosen)


def sample_places(start: int, length: int, most: int = _FRAMES) -> NDArray[np.intp]:
    """Choose places of a segment evenly from its first to its last, all if there are few.

    Args:
        start: its first place.
        length: how many it has, at least 1.
        most: how many to choose, at least 2.

    Returns:
        The places, (min(length, most),) int, ascending.

    """
    return start + np.linspace(0, length - 1, min(length, most)).round().astype(np.intp)


def _draw_route(axes: Axes, channel: ChannelSegments, runs: Runs, segments: list[int]) -> None:
    draw_bar(axes, runs)
    axes.set_axis_on()
    axes.set_title(
        summary(channel, runs), loc="left", fontsize=10, color=style.INK, pad=22 if segments else 4
    )
    axes.set(xlim=(0, len(channel.label)), yticks=[])
    axes.xaxis.set_major_locator(MaxNLocator(10, integer=True))
    axes.set_xlabel("Place")
    style.tidy(axes)
    axes.spines[["left", "bottom"]].set_visible(False)
    middle = runs.start[segments] + runs.length[segments] / 2
    letters = _spread(middle, len(channel.label))
    for line, (place, letter) in enumerate(zip(middle, letters, strict=True)):
        axes.plot([place, letter], [1, 1.25], color=style.MUTED, linewidth=0.8, clip_on=False)
        axes.text(
            letter,
            1.3,
            _letter(line),
            ha="center",
            va="bottom",
            fontsize=10,
            fontweight="bold",
            color=style.INK,
        )
    axes.set_ylim(0, 1)


def _spread(middle: NDArray[np.float64], places: int) -> NDArray[np.float64]:
    """Move what stands closer than letters are wide apart, and keep it within the route."""
    apart = 0.02 * places * np.arange(len(middle))
    moved = np.maximum.accumulate(middle - apart) + apart
    most = places - apart[::-1]
    spread: NDArray[np.float64] = np.minimum(moved, most)
    return spread


def _draw_segment(
    axes: Axes, runs: Runs, run: int, line: int, *, top: float, height: float
) -> None:
    """Write what a segment is, to the left of its frames."""
    start, length = int(runs.start[run]), int(runs.length[run])
    middle = top + height / 2
    axes.text(0, middle - 0.1, _letter(line), fontsize=13, fontweight="bold", color=style.INK)
    axes.text(
        0.62,
        middle - 0.14,
        str(length),
        ha="center",
        va="center",
        fontsize=10,
        color=style.INK,
        bbox={
            "boxstyle": "circle,pad=0.35",
            "facecolor": "white",
            "edgecolor": runs.colours[run],
            "linewidth": 2,
        },
    )
    last = f" to {start + length - 1}" if length > 1 else ""
    axes.text(0, middle + 0.2, f"{start}{last}", va="top", fontsize=9, color=style.MUTED)


def _letter(line: int) -> str:
    return chr(ord("A") + line)
