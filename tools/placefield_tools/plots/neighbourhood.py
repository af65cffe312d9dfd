"""Picture of the frames around one frame, before and after a metric was learned."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from placefield_tools.plots import style
from placefield_tools.plots.runs import ACTIVE

_OTHER = "#f0e442"  # Okabe and Ito's yellow, which wants a dark edge
_NEAREST = 60
_LEAST_REACH, _MOST_REACH = 1.5, 3.0  # of a panel, in distances of the farthest target neighbour


@dataclass(frozen=True, slots=True, eq=False)
class Neighbourhood:
    """Other frames as one frame sees them under one metric.

    Attributes:
        name: of the metric.
        offsets: of each other frame from the frame, projected, (n, M) float.
        same: it has the frame's label, (n,) bool.
        targets: it is one of the frame's target neighbours, (n,) bool; at least one is.
        margin: by which frames of another label have to be farther than the target neighbours,
            at least 0, in the unit of the squared offsets.

    """

    name: str
    offsets: NDArray[np.floating]
    same: NDArray[np.bool_]
    targets: NDArray[np.bool_]
    margin: float


def plot_neighbourhood(
    path: Path, before: Neighbourhood, after: Neighbourhood, title: str | None = None
) -> None:
    """Draw the frames around one frame, once under each metric.

    The frame is in the middle, every other at its true distance, in distances of that panel's
    farthest target neighbour; the directions are those of a projection (`plane_positions`). The
    circle goes through the farthest target neighbour, the dotted one lies the margin beyond it. The
    60 nearest frames and the target neighbours are drawn, three units from the middle at most; the
    counts are of all frames. After the AMS paper's figure 6.

    Args:
        path: the PNG file to write.
        before: the panel at the left.
        after: the panel at the right.
        title: printed above.

    Raises:
        OSError: the file cannot be written.
        ValueError: as `count_invaders` says.

    """
    for around in (before, after):
        _check(around)
    figure = style.new_figure(10, 5.9 if title else 5.5, title)
    panels = figure.subplots(1, 2)
    reach = float(np.clip(1.1 * max(_reach(before), _reach(after)), _LEAST_REACH, _MOST_REACH))
    for axes, around in zip(panels, (before, after), strict=True):
        _draw(axes, around, reach)
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside lower center",
        ncols=len(handles),
        frameon=False,
        fontsize=9,
        labelcolor=style.INK,
        handletextpad=0.4,
        columnspacing=1.6,
    )
    style.save(figure, path)


def count_invaders(around: Neighbourhood, *, with_margin: bool = False) -> int:
    """Count the frames of another label that are nearer than the farthest target neighbour.

    Args:
        around: the frames.
        with_margin: count those too that are less than the margin farther, which LMNN pushes away.

    Raises:
        ValueError: the shapes do not fit, an offset is not finite, no frame is a target neighbour,
            one of another label is, all are at no distance, or the margin is negative.

    """
    _check(around)
    squared = _squared_distances(around)
    boundary = squared[around.targets].max() + (around.margin if with_margin else 0)
    return int(np.count_nonzero(~around.same & (squared < boundary)))


def plane_positions(around: Neighbourhood) -> NDArray[np.float64]:
    """Give every other frame a position in the plane, with the frame at the origin.

    Its distance from there is the norm of its offset, over that of the farthest target neighbour.
    Its direction is that of the offset in the plane of the offsets' first two principal components,
    each turned so that its largest entry is positive; with no part in that plane, to the right.

    Returns:
        Positions, (n, 2) float64.

    Raises:
        ValueError: as `count_invaders` says.

    """
    _check(around)
    offsets = around.offsets.astype(np.float64)
    _, _, axes = np.linalg.svd(offsets - offsets.mean(axis=0), full_matrices=False)
    plane = np.zeros((2, offsets.shape[1]))
    plane[: len(axes)] = axes[:2]
    largest = np.take_along_axis(plane, np.abs(plane).argmax(axis=1)[:, None], axis=1)
    projected = offsets @ (np.where(largest < 0, -1, 1) * plane).T

    angle = np.arctan2(projected[:, 1], projected[:, 0])
    distance = np.sqrt(_squared_distances(around))
    radius = distance / distance[around.targets].max()
    positions: NDArray[np.float64] = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    return positions


def _check(around: Neighbourhood) -> None:
    same, targets = around.same, around.targets
    if around.offsets.ndim != 2 or not same.shape == targets.shape == around.offsets.shape[:1]:
        raise ValueError(
            f"{around.name}: offsets of shape {around.offsets.shape} do not go with {same.shape} "
            f"labels and {targets.shape} target neighbours"
        )
    if not np.isfinite(around.offsets).all():
        raise ValueError(f"{around.name}: an offset is not finite")
    if not targets.any():
        raise ValueError(f"{around.name}: there is no target neighbour")
    if (targets & ~same).any():
        raise ValueError(f"{around.name}: a target neighbour has another label")
    if not around.offsets[targets].any():
        raise ValueError(f"{around.name}: the target neighbours are at no distance")
    if not around.margin >= 0:
        raise ValueError(f"{around.name}: the margin {around.margin} is negative")


def _squared_distances(around: Neighbourhood) -> NDArray[np.float64]:
    offsets = around.offsets.astype(np.float64)
    squared: NDArray[np.float64] = np.einsum("nm,nm->n", offsets, offsets)
    return squared


def _drawn(around: Neighbourhood) -> Neighbourhood:
    """Leave only the nearest frames and the target neighbours, farthest first."""
    order = np.argsort(_squared_distances(around), kind="stable")
    near = np.zeros(len(order), dtype=np.bool_)
    near[order[:_NEAREST]] = True
    kept = order[::-1][(near | around.targets)[order[::-1]]]
    return replace(
        around,
        offsets=around.offsets[kept],
        same=around.same[kept],
        targets=around.targets[kept],
    )


def _margin_radius(around: Neighbourhood) -> float:
    boundary = _squared_distances(around)[around.targets].max()
    return float(np.sqrt(1 + around.margin / boundary))


def _reach(around: Neighbourhood) -> float:
    """Give how far out there is something to draw."""
    drawn = plane_positions(_drawn(around))
    return max(float(np.linalg.norm(drawn, axis=1).max()), _margin_radius(around))


def _draw(axes: Axes, around: Neighbourhood, reach: float) -> None:
    within = count_invaders(around)
    in_margin = count_invaders(around, with_margin=True)
    drawn = _drawn(around)
    positions = plane_positions(drawn)
    axes.add_patch(Circle((0, 0), 1, facecolor="#f6f8fa", edgecolor=style.INK, linewidth=1.4))
    axes.add_patch(
        Circle(
            (0, 0),
            _margin_radius(around),
            fill=False,
            edgecolor=style.INK,
            linewidth=1.4,
            linestyle=":",
        )
    )
    for target in positions[drawn.targets]:
        axes.plot(*zip((0, 0), target, strict=True), color=ACTIVE[0], linewidth=1.2)
    for name, colour, edge, chosen in (
        ("another label", _OTHER, style.INK, ~drawn.same),
        ("same label", ACTIVE[1], "white", drawn.same & ~drawn.targets),
        ("target neighbour", ACTIVE[0], "white", drawn.targets),
    ):
        axes.plot(
            *positions[chosen].T,
            "s",
            color=colour,
            markersize=7,
            markeredgecolor=edge,
            markeredgewidth=1,
            label=name,
        )
    axes.plot(0, 0, "o", color=style.INK, markersize=9, label="the frame", zorder=4)
    axes.plot([], [], color=style.INK, label="farthest target neighbour")
    axes.plot([], [], ":", color=style.INK, label="its margin")
    axes.set_title(
        f"{around.name}\n{within} of another label within the circle, "
        f"{in_margin} within the margin",
        loc="left",
        fontsize=10,
        color=style.INK,
    )
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    whole = int(reach)
    ticks = range(-whole, whole + 1)
    axes.set_xticks(ticks, [str(abs(tick)) for tick in ticks])
    axes.set_yticks(ticks, [str(abs(tick)) for tick in ticks])
    axes.set_xlabel(
        f"Distance (farthest target neighbour = 1) of the {_NEAREST} nearest frames", fontsize=9
    )
    style.tidy(axes)
