"""What more channels are worth: every number of them, combined (the paper's figures 18 to 20)."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from placefield.config import Config, Rule
from placefield.fusion.fusion_stage import FusionStage
from placefield.maps.map import MapChannel
from placefield_tools.evaluating import RULES, judge
from placefield_tools.progress import tracked
from placefield_tools.study.matching import candidates_of, fuse_channels
from placefield_tools.study.results import CountResult
from placefield_tools.study.trial import Trial

CHANNELS = 10
MOST_COMBINATIONS = 20
"""That are tried of each number of channels."""

Combination = tuple[int, ...]


def count_channels(trial: Trial) -> tuple[CountResult, ...]:
    """Match and judge combinations of every number of ten channels, by every rule.

    The metric is the identity.

    Raises:
        MapError: the reference is too short for so many channels.
    """
    channels = trial.build(_with_many_channels(trial.config)).channels
    with tracked(RULES, "combining channels", len(RULES)) as rules:
        return tuple(result for rule in rules for result in _count(trial, channels, rule))


def combinations(channels: int, number: int, seed: int) -> list[Combination]:
    """Return all combinations of so many channels, or ``MOST_COMBINATIONS`` drawn at random."""
    every = list(itertools.combinations(range(channels), number))
    if len(every) <= MOST_COMBINATIONS:
        return every
    rng = np.random.default_rng([seed, number])
    drawn = rng.choice(len(every), MOST_COMBINATIONS, replace=False)
    return [every[index] for index in sorted(drawn)]


def _count(trial: Trial, channels: Sequence[MapChannel], rule: Rule) -> Iterator[CountResult]:
    matching = trial.matching(rule)
    candidates = candidates_of(channels, trial.descriptors, trial.metres, matching)
    fusion = FusionStage(trial.placemap.places.same, matching)
    for number in range(1, len(channels) + 1):
        curves = [
            judge(fuse_channels([candidates[i] for i in chosen], fusion), trial.truth).curve
            for chosen in combinations(len(channels), number, trial.config.seed)
        ]
        yield CountResult(
            rule,
            number,
            np.array([curve.auc for curve in curves]),
            np.array([curve.recall_at_100_precision for curve in curves]),
        )


def _with_many_channels(config: Config) -> Config:
    return config.model_copy(
        update={
            "scales": config.scales.model_copy(update={"channels": CHANNELS}),
            "metric": config.metric.model_copy(update={"kind": "identity"}),
        }
    )
