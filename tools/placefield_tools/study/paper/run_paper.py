"""A reference and a query to the paper's experiments."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from placefield.config import Config
from placefield.errors import MapError
from placefield.features.kinds import DESCRIPTOR
from placefield.maps.map import MapChannel
from placefield_tools.common.progress import CONSOLE
from placefield_tools.evaluate.judging import Judged, judge
from placefield_tools.evaluate.query import Query
from placefield_tools.evaluate.truth_source import TruthOptions
from placefield_tools.sources import open_source
from placefield_tools.study.matching import with_scales
from placefield_tools.study.methods import PUBLISHED_RIVALS, match_smoothed, run_methods
from placefield_tools.study.neighbours import learned_by
from placefield_tools.study.paper.channel_count_runs import count_channels
from placefield_tools.study.paper.cost import measure_cost
from placefield_tools.study.paper.paper_results import CountResult, FeatureResult, Line, PaperStudy
from placefield_tools.study.run_study import TruthOf, prepare
from placefield_tools.study.trial import Trial, fixed_map

FEATURES = ("gist", "grayscale")
"""Those of the paper."""


def run_paper_study(
    reference: str,
    query: Query,
    truth_of: TruthOf,
    config: Config,
    features: Sequence[str] | None = None,
    *,
    tolerance: int | None,
    asked: TruthOptions | None = None,
) -> PaperStudy:
    """Run the paper's experiments, showing progress.

    Args:
        reference: source of the reference's frames.
        query: to match, and how it is driven.
        truth_of: gives the truth of the query in its own order.
        config: by the preset ``paper``; its kind of feature counts for nothing.
        features: kinds of those to run them on, at least one; None: those of the paper, or of
            descriptors just these.
        tolerance: shown in the report; None if a ground truth or metres were given.
        asked: the other options of the ground truth, see ``find_truth``.

    Raises:
        PlacefieldError: the sources or the truth cannot be read, or do not make a map of AMS, or
            there is no ground truth.
    """
    results: list[FeatureResult] = []
    for feature in features or _features_of(reference, query):
        CONSOLE.print(f"the paper's experiments on {feature}")
        kind = config.features.model_copy(update={"kind": feature})
        of_feature = config.model_copy(update={"features": kind})
        first = not results
        trial = prepare(reference, query, truth_of, of_feature, words=first, asked=asked)
        if first:
            others = run_methods(trial, PUBLISHED_RIVALS)
            every = trial.every
        results.append(run_feature(trial))
    return PaperStudy(
        reference=reference,
        query=query.where,
        protocol=query.protocol,
        every=every,
        seed=config.seed,
        tolerance=tolerance,
        ground=trial.ground,
        features=tuple(results),
        others=others,
    )


def _features_of(reference: str, query: Query) -> Sequence[str]:
    with open_source(reference, parts=query.parts) as source:
        return FEATURES if source.dimensions is None else (DESCRIPTOR,)


def run_feature(trial: Trial) -> FeatureResult:
    """Run the experiments on one feature.

    Args:
        trial: by the preset ``paper``.
    """
    adaptive = trial.placemap.channels
    fixed = fixed_map(trial)
    length = one_scale(adaptive)
    lines = [*_lines(trial, "AMS", adaptive, length)]
    if fixed is not None:
        lines = [*_lines(trial, "MS", fixed.channels, length), *lines]
    return FeatureResult(
        feature=trial.config.features.kind,
        placemap=trial.placemap,
        fixed=fixed,
        one_scale=length,
        lines=tuple(lines),
        counts=_counts(trial),
        learned=learned_by(trial),
        cost=measure_cost(trial),
    )


def one_scale(channels: Sequence[MapChannel]) -> int:
    """Return the middle one of all channels' scales, the longer of two, frames."""
    scales = np.sort(np.concatenate([channel.scales for channel in channels]))
    return int(scales[len(scales) // 2])


def _lines(
    trial: Trial, method: Literal["MS", "AMS"], channels: Sequence[MapChannel], length: int
) -> Iterator[Line]:
    alone = [with_scales(channel, [length]) for channel in channels]
    yield Line(method, "one", _judged(trial, alone))
    yield Line(method, "many", _judged(trial, channels))


def _judged(trial: Trial, channels: Sequence[MapChannel]) -> Judged:
    matched = match_smoothed(channels, trial, "ams", trial.config.matching.lag)
    return replace(judge(matched.matches, trial.truth), mean_lag=matched.mean_lag)


def _counts(trial: Trial) -> tuple[CountResult, ...]:
    try:
        return count_channels(trial)
    except MapError as error:
        CONSOLE.print(f"no combinations of channels: {error}", soft_wrap=True)
        return ()
