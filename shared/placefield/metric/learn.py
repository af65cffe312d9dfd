"""A channel's labels to its projection: LMNN with early stopping, behind the gate."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.metric.gate import Probes, passes_gate, probe_score
from placefield.metric.lmnn import fit_lmnn, loss, target_neighbours

__all__ = ["LearnedMetric", "Probes", "held_back_frames", "learn_projection"]

_BLOCK_FRAMES = 3
_PATIENCE = 5  # steps without a better validation loss before learning stops

Array = NDArray[np.float32]


@dataclass(frozen=True)
class LearnedMetric:
    """A channel's projection and how it came about.

    Attributes:
        projection: (N, N) float32, the paper's v; the identity where nothing better was learned.
        learned: whether the projection passed the gate.
        curve: (steps taken + 1, 2) float64, validation loss and gate score, of the identity and
            after each step.

    """

    projection: Array
    learned: bool
    curve: NDArray[np.float64]


def learn_projection(
    descriptors: Array,
    labels: NDArray[np.integer[Any]],
    held_back: NDArray[np.bool_],
    probes: Probes,
    *,
    neighbours: int,
    push: float,
    steps: int,
    tolerance: int,
    on_step: Callable[[int, float, float], None] | None = None,
) -> LearnedMetric:
    """Learn a projection that passes the gate, or return the identity.

    LMNN learns on the frames that are not held back. The validation loss is the LMNN objective of
    the held-back frames, with their targets among the others; when it has not improved for
    5 steps, learning stops. The projection with the lowest one is returned if it passes the gate.

    Args:
        descriptors: (K, N) float32 of the reference, several traverses one below the other.
        labels: (K,) int, equal for frames of one segment, whatever their traverse.
        held_back: (K,) bool, as `held_back_frames` makes it, the same places in every traverse.
        probes: what the gate asks.
        neighbours: target neighbours of each frame, k.
        push: weight of the push term, in [0, 1].
        steps: of gradient descent, at most.
        tolerance: how far from the truth a place is still right, in places.
        on_step: called after each step with its number, validation loss and gate score.

    The margin of 1 is measured in mean squared distances of training frames to their targets, so
    that what is learned does not depend on the descriptors' unit. The projection is scaled so that
    the mean squared distance between reference descriptors stays what it is: distances of channels
    with other metrics are then of one magnitude.
    """
    centred = descriptors - descriptors.mean(axis=0)
    targets = target_neighbours(centred, labels, neighbours, eligible=~held_back)
    held_back_targets = np.where(held_back[:, None], targets, -1)
    training_targets = np.where(held_back[:, None], -1, targets)
    points = centred / _target_distance(centred, training_targets)

    def measure(projection: Array) -> tuple[float, float]:
        return (
            loss(projection, points, labels, held_back_targets, push),
            probe_score(projection, probes, tolerance),
        )

    identity = np.eye(descriptors.shape[1], dtype=np.float32)
    best, best_step = identity, 0
    curve = [measure(identity)]

    def validate(step: int, projection: Array) -> bool:
        nonlocal best, best_step
        curve.append(measure(projection))
        if curve[step][0] < curve[best_step][0]:
            best, best_step = projection, step
        if on_step is not None:
            on_step(step, *curve[step])
        return step - best_step >= _PATIENCE

    fit_lmnn(
        points[~held_back],
        labels[~held_back],
        neighbours=neighbours,
        push=push,
        steps=steps,
        on_step=validate,
    )
    learned = passes_gate(best, probes, tolerance)
    projection = _rescale(best, centred) if learned else identity
    return LearnedMetric(projection, learned, np.array(curve))


def held_back_frames(count: int, fraction: float, seed: int) -> NDArray[np.bool_]:
    """Choose the frames of a traverse to hold back, about `fraction` of `count`, as (count,) bool.

    They come in blocks of 3 consecutive frames, chosen at random: single frames would leave almost
    their copies in training, and longer blocks would hold back whole segments.
    """
    blocks = -(-count // _BLOCK_FRAMES)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(blocks, size=round(fraction * blocks), replace=False)
    return np.isin(np.arange(count) // _BLOCK_FRAMES, chosen)


def _target_distance(descriptors: Array, targets: NDArray[np.intp]) -> np.float32:
    """Root mean squared distance to the targets; 1 where there are none or all are copies."""
    frames, columns = np.nonzero(targets >= 0)
    offsets = descriptors[frames] - descriptors[targets[frames, columns]]
    mean_square = np.einsum("tn,tn->", offsets, offsets) / max(len(frames), 1)
    return np.float32(np.sqrt(mean_square) or 1)


def _rescale(projection: Array, centred: Array) -> Array:
    """Scale a projection to keep the mean squared distance, twice the total variance, of frames."""
    ratio = np.linalg.norm(centred) / np.linalg.norm(centred @ projection.T)
    return np.asarray(projection * ratio, dtype=np.float32)
