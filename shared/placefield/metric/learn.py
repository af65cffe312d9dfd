"""From a channel's labels to its projection: a learner, followed by the gate."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.config import MetricConfig
from placefield.metric.gate import Probes, passes_gate, probe_score
from placefield.metric.learners import NothingLearnedError, fit_reference_learner
from placefield.metric.lmnn import fit_lmnn, loss, target_distances, target_neighbours
from placefield.metric.metric_learn_lmnn import fit_lmnn_by_metric_learn
from placefield.metric.rank import reduce_rank

__all__ = ["LearnedMetric", "Probes", "held_back_frames", "learn_projection"]

BLOCK_FRAMES = 3
"""How many consecutive frames are held back together."""

_PATIENCE = 5  # steps without a better validation loss before learning stops
_NO_PROBES = "there is no other traverse that could show that a metric helps"
_REFUSAL = "it does not recognise places better than the identity"

Array = NDArray[np.float32]
Labels = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class LearnedMetric:
    """A channel's projection and how it was learned.

    Attributes:
        projection: (R, N) float32, the paper's v, of as few rows as keep ``MetricConfig.kept`` of
            the distances; the (N, N) identity if nothing better was learned.
        refusal: why it is the identity; empty if it was learned and passed the gate.
        curve: (n, 2) float64, validation loss and gate score: of the identity, and of the learned
            metric, by LMNN after each step, by the other learners at the end.
    """

    projection: Array
    refusal: str
    curve: NDArray[np.float64]

    @property
    def learned(self) -> bool:
        """Whether the projection was learned and passed the gate."""
        return not self.refusal

    def arrays(self) -> tuple[Array, NDArray[np.str_], NDArray[np.float64]]:
        """Return all that it is, as arrays without objects."""
        return self.projection, np.array(self.refusal), self.curve

    @staticmethod
    def of(
        projection: Array, refusal: NDArray[np.str_], curve: NDArray[np.float64]
    ) -> "LearnedMetric":
        """Return the metric of such arrays."""
        return LearnedMetric(projection, str(refusal), curve)


def learn_projection(
    descriptors: Array,
    labels: Labels,
    trained: int,
    probes: Probes | None,
    config: MetricConfig,
    seed: int,
    *,
    on_step: Callable[[int, float, float], None] | None = None,
) -> LearnedMetric:
    """Learn a projection that passes the gate; if none does, return the identity.

    The first frames are for training; the others are held back. The validation loss is the LMNN
    objective of the held-back frames, with their targets among the first. LMNN stops when the loss
    has not improved for 5 steps, and returns the projection of the lowest loss.

    Args:
        descriptors: (K, N) float32 of the reference, centred, because a large common offset costs
            digits; of all its traverses, in any order with the held-back frames last, so that no
            channel needs a copy of the first.
        labels: (K,) int, equal for frames of one segment, whatever their traverse.
        trained: how many frames are for training.
        probes: for the gate; None if there is no other traverse.
        config: the learner and its settings; not the identity, and push a number.
        seed: of what is random in a learner.
        on_step: called after each measurement of the curve but the first, with its number,
            validation loss and gate score. An exception of it ends the learning.

    The margin of 1 is measured in mean squared distances of training frames to their targets, so
    that the result does not depend on the descriptors' unit. The projection is scaled to keep the
    mean squared distance between reference descriptors: distances of channels with other metrics
    are then of one magnitude.
    """
    identity = np.eye(descriptors.shape[1], dtype=np.float32)
    if probes is None and config.gate:
        return LearnedMetric(identity, _NO_PROBES, np.empty((0, 2)))
    training = descriptors[:trained], labels[:trained]
    is_trained = np.arange(len(labels)) < trained
    targets = target_neighbours(descriptors, labels, config.neighbours, eligible=is_trained)
    held_back_targets = np.where(is_trained[:, None], -1, targets)
    # The projection takes the unit in, so that no scaled copy of the descriptors is needed.
    start = identity / _target_distance(training[0], targets[:trained])
    curve: list[tuple[float, float]] = []

    def validate(projection: Array) -> float:
        validation_loss = loss(
            projection, descriptors, labels, held_back_targets, config.push_share
        )
        gate_score = 0.0 if probes is None else probe_score(projection, probes)
        curve.append((validation_loss, gate_score))
        if on_step is not None and len(curve) > 1:
            on_step(len(curve) - 1, *curve[-1])
        return validation_loss

    validate(start)
    try:
        if config.kind == "lmnn":
            best = _learn_lmnn(*training, start, config, validate, curve[0][0])
        else:
            points = training[0] @ start
            best = fit_reference_learner(points, training[1], config, seed) @ start
            validate(best)
    except NothingLearnedError as nothing:
        return LearnedMetric(identity, str(nothing), np.array(curve))
    best = reduce_rank(best, descriptors, labels, config.kept)
    if config.gate and probes is not None and not passes_gate(best, probes):
        return LearnedMetric(identity, _REFUSAL, np.array(curve))
    return LearnedMetric(_rescale(best, descriptors), "", np.array(curve))


def held_back_frames(count: int, fraction: float, seed: int) -> NDArray[np.bool_]:
    """Choose the frames of a traverse to hold back, about `fraction` of `count`, as (count,) bool.

    They are random blocks of 3 consecutive frames. Single frames would leave near copies of
    themselves in training, and longer blocks would hold back whole segments.
    """
    blocks = -(-count // BLOCK_FRAMES)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(blocks, size=round(fraction * blocks), replace=False)
    return np.isin(np.arange(count) // BLOCK_FRAMES, chosen)


def _learn_lmnn(
    descriptors: Array,
    labels: Labels,
    start: Array,
    config: MetricConfig,
    validate: Callable[[Array], float],
    identity_loss: float,
) -> Array:
    """Learn by LMNN until the validation loss stops improving; return the best projection."""
    best = start
    losses = [identity_loss]

    def is_over(step: int, projection: Array) -> bool:
        nonlocal best
        losses.append(validate(projection))
        best_step = int(np.argmin(losses))
        if best_step == step:
            best = projection
        return step - best_step >= _PATIENCE

    fit = fit_lmnn if config.solver == "placefield" else fit_lmnn_by_metric_learn
    fit(
        descriptors,
        labels,
        neighbours=config.neighbours,
        push=config.push_share,
        steps=config.steps,
        start=start,
        on_step=is_over,
    )
    return best


def _target_distance(descriptors: Array, targets: NDArray[np.intp]) -> np.float32:
    """Return the root mean squared distance to the targets; 1 if none or only copies exist."""
    total = target_distances(descriptors, targets).sum(dtype=np.float64)
    count = max(int(np.count_nonzero(targets >= 0)), 1)
    return np.float32(np.sqrt(total / count) or 1)


def _rescale(projection: Array, centred: Array) -> Array:
    """Scale a projection to keep the mean squared distance, twice the total variance, of frames."""
    ratio = np.linalg.norm(centred) / np.linalg.norm(centred @ projection.T)
    return np.asarray(projection * ratio, dtype=np.float32)
