"""Picture of a distance matrix with the matches drawn in."""

from pathlib import Path

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from placefield_tools.plots import style

# From dark, near, to white, far; not from black, on which the matches would be lost.
_GREY = LinearSegmentedColormap.from_list("near to far", ["#4d4d4d", "#ffffff"])


def plot_distance_matrix(
    path: Path,
    distances: NDArray[np.float32],
    matches: NDArray[np.integer],
    correct: NDArray[np.bool_],
    title: str,
) -> None:
    """Draw the distances in grey, near is dark, with right and wrong matches in two colours.

    Query frames run to the right and places upwards, so a query at the reference's speed climbs
    along the diagonal. The grey spans the 1st to the 99th percentile of the finite distances.

    Args:
        path: the PNG file to write.
        distances: query frame to place, (Q, K) float32; what is not finite stays white.
        matches: place of each query frame, (Q,) int; -1 is unanswered and not drawn.
        correct: the match is right, (Q,) bool.
        title: printed above.

    Raises:
        OSError: the file cannot be written.

    """
    queries, places = distances.shape
    figure = style.new_figure(6.4, 6.6, title)
    axes = figure.add_subplot()
    finite = distances[np.isfinite(distances)]
    near, far = np.percentile(finite, (1, 99)) if finite.size else (0, 1)
    axes.imshow(
        np.where(np.isfinite(distances), distances, np.nan).T,
        cmap=_GREY,
        vmin=near,
        vmax=far,
        origin="lower",
        aspect="auto",
        extent=(-0.5, max(queries, 1) - 0.5, -0.5, max(places, 1) - 0.5),
    )
    axes.set(xlabel="Query frame", ylabel="Place")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True))

    answered = matches >= 0
    dot = float(np.clip(800 / max(queries, places, 1), 3, 6))
    for name, colour, chosen in (
        ("right", style.RIGHT, answered & correct),
        ("wrong", style.WRONG, answered & ~correct),
    ):
        frames = np.flatnonzero(chosen)
        axes.plot(
            frames,
            matches[frames],
            "o",
            markerfacecolor="none",  # the distance inside stays visible
            markeredgecolor=colour,
            markersize=dot,
            markeredgewidth=0.8,
            label=f"{frames.size} {name}",
        )
    axes.plot([], [], " ", label=f"{np.count_nonzero(~answered)} unanswered")
    style.tidy(axes)
    figure.legend(
        loc="outside lower center",
        ncols=3,
        columnspacing=2.5,
        handlelength=1,
        handletextpad=0.4,
        frameon=False,
        fontsize=10,
        labelcolor=style.INK,
        markerscale=5 / dot,
    )
    style.save(figure, path)
