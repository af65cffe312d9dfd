"""A picture of the routes of a map and the links between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch
from numpy.typing import NDArray

from placefield.maps.linking import Overlap
from placefield.maps.route_graph import RouteGraph
from placefield_tools.plots import style

_COLOURS = ("#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
"""Of the routes, in turn: Okabe and Ito's, without the colour of the links."""

_ALONG, _ACROSS = 0.1, 0.2  # how far a link bends, in its length, along a level route and elsewhere

Positions = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DrawnNetwork:
    """The routes of a map of K places.

    Attributes:
        graph: the routes and links.
        overlaps: stretches that two routes share.
        positions: (K, 2) float64, x and y in metres; (0, 2) where they are not all known.
        count: K.
    """

    graph: RouteGraph
    overlaps: Sequence[Overlap]
    positions: Positions
    count: int


def plot_network(path: Path, network: DrawnNetwork) -> None:
    """Draw the routes as lines from a dot at their start, and the links as arrows in orange.

    With positions, it is a map in metres. Without, each route is a level line of its places, which
    stands below the places of an earlier route that it shares a stretch with; a grey band joins
    both copies of such a stretch.

    Args:
        path: the PNG file to write.
        network: what is drawn.

    Raises:
        OSError: the file cannot be written.
    """
    metric = len(network.positions) > 0
    at = network.positions if metric else schematic(network)
    rows = len(network.graph.names)
    title = "Routes, and links between them in orange"
    figure = style.new_figure(8, 6 if metric else 2.0 + 0.6 * rows, title)
    axes = figure.subplots()
    if not metric:
        _draw_overlaps(axes, network, at)
    _draw_routes(axes, network, at)
    for one, other in network.graph.links.tolist():
        axes.add_patch(_arrow(at[one], at[other]))
    style.tidy(axes)
    axes.margins(0.06, 0.1 if metric else 0.35)
    if metric:
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(xlabel="x, m", ylabel="y, m")
    else:
        axes.set(xlabel="Places", yticks=[])
        axes.spines["left"].set_visible(False)
    style.save(figure, path)


def schematic(network: DrawnNetwork) -> Positions:
    """Return positions of places without poses, (K, 2): x along a route, y minus its number.

    A route begins where an overlap with an earlier route, or else a link, puts it; otherwise at 0.
    """
    at = np.zeros((network.count, 2))
    bounds = pairwise([*network.graph.first.tolist(), network.count])
    for route, (start, end) in enumerate(bounds):
        x = _start_of(network, start, end, at[:, 0])
        at[start:end] = np.column_stack([x + np.arange(end - start), np.full(end - start, -route)])
    return at


def _start_of(network: DrawnNetwork, start: int, end: int, x: NDArray[np.float64]) -> float:
    for overlap in network.overlaps:
        if start <= overlap.first < end and overlap.twin_of_first < start:
            return float(x[overlap.twin_of_first]) - (overlap.first - start)
    for one, other in network.graph.links:
        if start <= other < end and one < start:
            return float(x[one] + 1 - (other - start))
        if start <= one < end and other < start:
            return float(x[other] - 1 - (one - start))
    return 0.0


def _draw_routes(axes: Axes, network: DrawnNetwork, at: Positions) -> None:
    bounds = pairwise([*network.graph.first.tolist(), network.count])
    routes = zip(network.graph.names, bounds, strict=True)
    for number, (name, (start, end)) in enumerate(routes):
        colour = _COLOURS[number % len(_COLOURS)]
        axes.plot(*at[start:end].T, color=colour, linewidth=2)
        axes.plot(*at[start], "o", color=colour, markersize=5)
        axes.annotate(
            Path(name).name,
            at[start],
            (2, 6),
            textcoords="offset points",
            color=colour,
            fontsize=9,
            parse_math=False,
        )


def _draw_overlaps(axes: Axes, network: DrawnNetwork, at: Positions) -> None:
    for first, last, twin, twin_of_last in network.overlaps:
        corners = at[[first, last, twin_of_last, twin]]
        axes.fill(*corners.T, color=style.FAINT, zorder=0)


def _arrow(start: Positions, end: Positions) -> FancyArrowPatch:
    return FancyArrowPatch(
        (start[0], start[1]),
        (end[0], end[1]),
        connectionstyle=f"arc3,rad={_ALONG if start[1] == end[1] else _ACROSS}",
        arrowstyle="-|>",
        mutation_scale=9,
        color=style.WRONG,
        linewidth=1.2,
        zorder=3,
    )
