"""A picture of the alignment of traverses to the first."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from placefield_tools.plots import style


@dataclass(frozen=True, eq=False)
class AlignedTraverse:
    """A traverse of F frames, aligned to the first.

    Attributes:
        title: printed above its diagram.
        places: (F,) int32, the place that each frame shows; -1 if it shows no place.
    """

    title: str
    places: NDArray[np.int32]


def plot_alignment(path: Path, traverses: Sequence[AlignedTraverse], places: int) -> None:
    """Draw one diagram per traverse: place over frame, with frames that show no place in orange.

    A drive at the speed of the first traverse is a line of slope 1, a stop is level, and a stretch
    off the route is a gap.

    Args:
        path: the PNG file to write.
        traverses: from top to bottom, at least one.
        places: number of places of the map, K.

    Raises:
        OSError: the file cannot be written.
        ValueError: there is no traverse to draw.
    """
    if not traverses:
        raise ValueError("there is no traverse to draw")
    figure = style.new_figure(
        8, 0.8 + 2.4 * len(traverses), "Traverses along the places: aligned blue, left out orange"
    )
    grid = figure.subplots(len(traverses), 1, squeeze=False)[:, 0]
    for axes, traverse in zip(grid, traverses, strict=True):
        frames = np.arange(len(traverse.places))
        shown = traverse.places >= 0
        axes.plot(frames[shown], traverse.places[shown], ".", color=style.RIGHT, markersize=3)
        left_out = frames[~shown]
        axes.plot(left_out, np.zeros(len(left_out)), ".", color=style.WRONG, markersize=5)
        axes.set(xlim=(-0.5, len(frames) - 0.5), ylim=(-places / 20, places), ylabel="Place")
        axes.set_title(traverse.title, loc="left", fontsize=10, color=style.INK, parse_math=False)
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        style.tidy(axes)
    grid[-1].set_xlabel("Frame")
    style.save(figure, path)
