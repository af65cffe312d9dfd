"""What more channels are worth: every number of ten, combined (the paper's figures 18 to 20)."""

import itertools
from collections.abc import Sequence

import numpy as np

from placefield.fusion.fusion_stage import FusionStage
from placefield.matching.candidate import Candidate
from placefield_tools.common.progress import tracked
from placefield_tools.evaluate.evaluation import judge
from placefield_tools.study.matching import fuse_channels, smoothed_candidates
from placefield_tools.study.paper.paper_results import CountResult
from placefield_tools.study.trial import Trial

CHANNELS = 10
MOST_COMBINATIONS = 60
"""That are tried of each number of channels."""

Combination = tuple[int, ...]


def count_channels(trial: Trial) -> tuple[CountResult, ...]:
    """Match and judge combinations of every number of ten channels, each with its own metric.

    Args:
        trial: by the preset ``paper``.

    Raises:
        MapError: the reference is too short for so many channels.
    """
    scales = trial.config.scales.model_copy(update={"channels": CHANNELS})
    placemap = trial.build(trial.config.model_copy(update={"scales": scales}))
    matching = trial.matching("ams")
    candidates = smoothed_candidates(placemap.channels, trial.descriptors, trial.metres, matching)
    fusion = FusionStage(placemap.topology, matching)
    numbers = range(1, CHANNELS + 1)
    with tracked(numbers, "combining channels", CHANNELS) as in_turn:
        return tuple(_count(trial, candidates, number, fusion) for number in in_turn)


def combinations(channels: int, number: int, seed: int) -> list[Combination]:
    """Return all combinations of so many channels, or ``MOST_COMBINATIONS`` drawn at random."""
    every = list(itertools.combinations(range(channels), number))
    if len(every) <= MOST_COMBINATIONS:
        return every
    rng = np.random.default_rng([seed, number])
    drawn = rng.choice(len(every), MOST_COMBINATIONS, replace=False)
    return [every[index] for index in sorted(drawn)]


def _count(
    trial: Trial, candidates: Sequence[Sequence[Candidate]], number: int, fusion: FusionStage
) -> CountResult:
    curves = [
        judge(fuse_channels([candidates[i] for i in chosen], fusion), trial.truth).curve
        for chosen in combinations(CHANNELS, number, trial.config.seed)
    ]
    return CountResult(
        number,
        np.array([curve.auc for curve in curves]),
        np.array([curve.recall_at_100_precision for curve in curves]),
    )
