"""Cross-validation of the weight of LMNN's push term, as the AMS paper proposes.

The places are partitioned into 5 parts, so that each part in turn is the 20 % that are held back.
For each weight a metric is learned on the other parts. An error is a held-back frame whose nearest
frame in the other parts is not of its own segment. The chosen weight is that of the fewest errors,
and the smallest of several such.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.config import MetricConfig
from placefield.metric.learn import BLOCK_FRAMES, learn_projection
from placefield.metric.squared_distances import squared_distances

LAMBDAS = (0.25, 0.5, 0.75, 1.0)
"""The values of the paper's λ, from 0 to 1, that are tried; see ``push_of``."""

_PARTS = 5
_BLOCK = 512  # frames whose distances are held at once

Array = NDArray[np.float32]
Labels = NDArray[np.integer[Any]]


def push_of(weight: float) -> float:
    """Return the fraction of the push term in E for the paper's λ: λ / (1 + λ)."""
    return weight / (1 + weight)


def choose_push(
    descriptors: Array,
    labels: Labels,
    places: NDArray[np.integer[Any]],
    config: MetricConfig,
    seed: int,
) -> float:
    """Choose the push of ``fit_lmnn`` among those of ``LAMBDAS``.

    Args:
        descriptors: (K, N) float32, centred, of the reference's frames.
        labels: (K,) int, equal for frames of one segment.
        places: (K,) int, the place of each frame: frames of one place are held back together.
        config: the learner's other settings.
        seed: of the random partition.
    """
    parts = _parts(places, seed)
    errors = [_errors(descriptors, labels, parts, config, push_of(weight)) for weight in LAMBDAS]
    return push_of(LAMBDAS[int(np.argmin(errors))])


def _parts(places: NDArray[np.integer[Any]], seed: int) -> NDArray[np.integer[Any]]:
    """Partition the places in blocks of consecutive ones, like ``held_back_frames``: (K,) parts."""
    of_block = np.random.default_rng(seed).permutation(int(places.max()) // BLOCK_FRAMES + 1)
    return np.asarray(of_block[places // BLOCK_FRAMES] % _PARTS)


def _errors(
    descriptors: Array, labels: Labels, parts: Labels, config: MetricConfig, push: float
) -> int:
    """Count the frames whose nearest frame in the other parts is of another segment."""
    ungated = config.model_copy(update={"push": push, "gate": False})
    wrong = 0
    for part in range(_PARTS):
        held_back = parts == part
        order = np.argsort(held_back, kind="stable")
        trained = int((~held_back).sum())
        ordered, own = descriptors[order], labels[order]
        metric = learn_projection(ordered, own, trained, None, ungated, seed=0)
        projected = ordered @ metric.projection.T
        for block in blocks(len(own) - trained, _BLOCK):
            queries = slice(trained + block.start, trained + block.stop)
            nearest = squared_distances(projected[queries], projected[:trained]).argmin(axis=1)
            wrong += int((own[:trained][nearest] != own[queries]).sum())
    return wrong
