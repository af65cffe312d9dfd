"""Picture of query frames beside the places that they were matched to."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from placefield_tools.plots import style
from placefield_tools.plots.frame_pictures import height_per_width, shown

_PICTURE_WIDTH = 3.2
_TEXT_WIDTH = 1.2
_WIDTH = _TEXT_WIDTH + 2 * _PICTURE_WIDTH


@dataclass(frozen=True, slots=True, eq=False)
class MatchPair:
    """One match, with the pictures to judge it by.

    Attributes:
        query_image: (H, W) grey or (H, W, 3) BGR, uint8.
        place_image: the same of the place, of any size.
        query: index of the query frame.
        place: index of the place.
        correct: the match is right.
        score: higher is more confident.
        certainty: known, likely or unknown; None where the rule does not say.

    """

    query_image: NDArray[np.uint8]
    place_image: NDArray[np.uint8]
    query: int
    place: int
    correct: bool
    score: float
    certainty: str | None = None


def plot_match_pairs(path: Path, pairs: Sequence[MatchPair]) -> None:
    """Draw one row per match: a verdict, the query frame, and the place beside it.

    Args:
        path: the PNG file to write.
        pairs: the matches, from top to bottom; if there are none, the picture says so.

    Raises:
        OSError: the file cannot be written.

    """
    if not pairs:
        style.save(style.new_figure(_WIDTH, 0.6, "No matches"), path)
        return
    heights = [
        _PICTURE_WIDTH * height_per_width((pair.query_image, pair.place_image)) for pair in pairs
    ]
    figure = style.new_figure(_WIDTH, sum(heights) + 0.3 * len(pairs))
    grid = figure.add_gridspec(
        len(pairs),
        3,
        width_ratios=[_TEXT_WIDTH, _PICTURE_WIDTH, _PICTURE_WIDTH],
        height_ratios=heights,
    )
    for row, pair in enumerate(pairs):
        _verdict(figure.add_subplot(grid[row, 0]), pair)
        _picture(figure.add_subplot(grid[row, 1]), pair.query_image, f"query {pair.query}", pair)
        _picture(figure.add_subplot(grid[row, 2]), pair.place_image, f"place {pair.place}", pair)
    style.save(figure, path)


def _colour(pair: MatchPair) -> str:
    return style.RIGHT if pair.correct else style.WRONG


def _verdict(axes: Axes, pair: MatchPair) -> None:
    axes.set_axis_off()
    word = "right" if pair.correct else "wrong"
    axes.text(0, 0.53, word, fontsize=15, fontweight="bold", color=_colour(pair), va="bottom")
    said = [] if pair.certainty is None else [textwrap.fill(pair.certainty, 14)]
    below = "\n".join([*said, f"score {pair.score:.3g}"])
    axes.text(0, 0.47, below, fontsize=10, color=style.MUTED, va="top")


def _picture(axes: Axes, image: NDArray[np.uint8], name: str, pair: MatchPair) -> None:
    axes.imshow(shown(image), cmap="gray", vmin=0, vmax=255)
    axes.set_title(name, loc="left", fontsize=10, color=style.INK, pad=3)
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(color=_colour(pair), linewidth=2.5)
