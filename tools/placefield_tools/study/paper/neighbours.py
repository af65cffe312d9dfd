"""What a metric does to a frame's neighbours (the paper's figure 6)."""

import numpy as np
from numpy.typing import NDArray

from placefield.metric.lmnn import target_neighbours
from placefield.metric.squared_distances import squared_distances
from placefield_tools.plots import Neighbourhood
from placefield_tools.study.paper.paper_results import Learned
from placefield_tools.study.trial import Trial

Array = NDArray[np.float64]
Labels = NDArray[np.int32]


def learned_by(trial: Trial) -> Learned:
    """Look at what the first channel's metric does to the reference's frames.

    Args:
        trial: by the preset ``paper``.
    """
    placemap, neighbours = trial.placemap, trial.config.metric.neighbours
    channel = placemap.channels[0]
    descriptors = placemap.model.of_reference(trial.traverse.raw)
    targets = target_neighbours(descriptors, channel.labels, neighbours)
    before = descriptors.astype(np.float64)
    after = before @ channel.metric.projection.T.astype(np.float64)
    invaders = _invaders(before, channel.labels, targets)
    place = int(np.argmax(invaders))
    margin = _target_distance(before, targets)
    return Learned(
        place,
        _around(place, before, channel.labels, targets, margin, "before learning"),
        _around(place, after, channel.labels, targets, margin, "after learning"),
        float(invaders.mean()),
        float(_invaders(after, channel.labels, targets).mean()),
    )


def _invaders(points: Array, labels: Labels, targets: NDArray[np.intp]) -> NDArray[np.int64]:
    """Count, for each point (K, N), those of other labels nearer than its farthest target."""
    squared = squared_distances(points, points)
    has = (targets >= 0).any(axis=1)
    own = np.take_along_axis(squared, np.maximum(targets, 0), axis=1)
    radii = np.where(targets >= 0, own, 0).max(axis=1)
    nearer = (squared < radii[:, None]) & (labels[:, None] != labels)
    return np.asarray(np.where(has, nearer.sum(axis=1), 0))


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
