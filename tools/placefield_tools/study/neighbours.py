"""What a metric does to a frame's neighbours (the paper's figure 6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.metric.lmnn import target_neighbours
from placefield.metric.squared_distances import squared_distances
from placefield_tools.plots import Neighbourhood
from placefield_tools.study.trial import Trial

Array = NDArray[np.float64]
Labels = NDArray[np.int32]

_BLOCK = 256  # frames whose distances to all others are held at once


@dataclass(frozen=True, eq=False)
class Learned:
    """What a channel's metric does to the frame that has the most invaders without it.

    Attributes:
        place: of the frame.
        before: its neighbours under the identity.
        after: the same under the metric.
        invaders_before: mean over all frames of how many frames of other labels are nearer than the
            farthest target neighbour, under the identity.
        invaders_after: the same under the metric.
    """

    place: int
    before: Neighbourhood
    after: Neighbourhood
    invaders_before: float
    invaders_after: float


def learned_by(trial: Trial) -> Learned | None:
    """Look at what the first channel's metric does to the reference's frames.

    Returns:
        What it does; None where no metric was learned, or no frame has a target neighbour that
        differs from it.
    """
    placemap, neighbours = trial.placemap, trial.config.metric.neighbours
    channel = placemap.channels[0]
    if not channel.metric.learned:
        return None
    descriptors = placemap.model.of_reference(trial.traverse.raw)
    targets = target_neighbours(descriptors, channel.labels, neighbours)
    before = descriptors.astype(np.float64)
    after = before @ channel.metric.projection.T.astype(np.float64)
    radii, radii_after = _radii(before, targets), _radii(after, targets)
    can_show = (radii > 0) & (radii_after > 0)
    if not can_show.any():
        return None
    invaders = _invaders(before, channel.labels, radii)
    place = int(np.argmax(np.where(can_show, invaders, -1)))
    margin = _target_distance(before, targets)
    return Learned(
        place,
        _around(place, before, channel.labels, targets, margin, "before learning"),
        _around(place, after, channel.labels, targets, margin, "after learning"),
        float(invaders.mean()),
        float(_invaders(after, channel.labels, radii_after).mean()),
    )


def _radii(points: Array, targets: NDArray[np.intp]) -> Array:
    """Return the squared distance of each point (K, N) to its farthest target; 0 without one."""
    offsets = points[:, None] - points[np.maximum(targets, 0)]
    squared = np.where(targets >= 0, (offsets**2).sum(axis=2), 0)
    return np.asarray(squared.max(axis=1))


def _invaders(points: Array, labels: Labels, radii: Array) -> NDArray[np.int64]:
    """Count, for each point (K, N), those of other labels nearer than its radius, squared."""
    counts = np.zeros(len(points), np.int64)
    for first in range(0, len(points), _BLOCK):
        rows = slice(first, first + _BLOCK)
        near = squared_distances(points[rows], points) < radii[rows, None]
        counts[rows] = (near & (labels[rows, None] != labels)).sum(axis=1)
    return counts


def _target_distance(points: Array, targets: NDArray[np.intp]) -> float:
    """Return the mean squared distance to the targets, the margin's unit; 1 where there is none."""
    first, column = np.nonzero(targets >= 0)
    offsets = points[first] - points[targets[first, column]]
    return float((offsets**2).sum(axis=1).mean()) if len(first) else 1.0


def _around(
    place: int, points: Array, labels: Labels, targets: NDArray[np.intp], margin: float, name: str
) -> Neighbourhood:
    others = np.flatnonzero(np.arange(len(points)) != place)
    return Neighbourhood(
        name=name,
        offsets=points[others] - points[place],
        same=labels[others] == labels[place],
        targets=np.isin(others, targets[place]),
        margin=margin,
    )
