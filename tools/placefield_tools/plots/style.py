"""The look that all pictures share: light, few lines, colours that colour-blind people tell apart.

Figures are made by object, never by pyplot, so that no state outlives a picture.
"""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from placefield.files import written_whole

INK = "#222222"
MUTED = "#6b6b6b"
FAINT = "#e4e4e4"
RIGHT = "#0072b2"
WRONG = "#d55e00"

_DOTS_PER_INCH = 150


def new_figure(width: float, height: float, title: str | None = None) -> Figure:
    """Make an empty figure of `width` × `height` inches with its title at the left."""
    figure = Figure(
        figsize=(width, height),
        dpi=_DOTS_PER_INCH,
        layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1),
        facecolor="white",
    )
    if title:
        figure.suptitle(title, x=0.1 / width, ha="left", fontsize=13, fontweight="bold", color=INK)
    return figure


def tidy(axes: Axes) -> None:
    """Leave of the frame only the two lines that carry the ticks, and make them quiet."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(colors=MUTED, labelsize=9)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)


def save(figure: Figure, path: Path) -> None:
    """Write the figure to `path` as a PNG.

    Raises:
        OSError: the file cannot be written.

    """
    with written_whole(path) as beside:
        figure.savefig(beside, format="png")
