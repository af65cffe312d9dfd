"""What adaptive scales are worth, one and many (the paper's figures 16 and 17)."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from placefield.errors import MapError
from placefield.maps.map import MapChannel
from placefield_tools.evaluating import judge
from placefield_tools.study.matching import match_channels, median_scale, with_scales
from placefield_tools.study.results import ScaleResult
from placefield_tools.study.trial import Trial


def compare_scales(trial: Trial) -> tuple[ScaleResult, ...]:
    """Match by the fixed scales of MS, where the reference is long enough, and by adaptive ones.

    All as published: metrics by LMNN, the rule ``lowest-score``. One scale is the middle one of a
    channel, and the figures are the mean over the channels, each by itself; many are all scales of
    all channels.
    """
    adaptive = _compare(trial, "AMS", trial.published.channels)
    try:
        fixed = trial.multiscale.channels
    except MapError:
        return adaptive
    return _compare(trial, "MS", fixed) + adaptive


def _compare(
    trial: Trial, method: Literal["MS", "AMS"], channels: Sequence[MapChannel]
) -> tuple[ScaleResult, ...]:
    alone = [_figures(trial, [with_scales(one, [median_scale(one)])]) for one in channels]
    auc, recall = np.mean(alone, axis=0).tolist()
    return (
        ScaleResult(method, "one", auc, recall),
        ScaleResult(method, "many", *_figures(trial, channels)),
    )


def _figures(trial: Trial, channels: Sequence[MapChannel]) -> tuple[float, float]:
    matching = trial.matching("lowest-score")
    matches = match_channels(channels, trial.descriptors, trial.metres, matching)
    curve = judge(matches, trial.truth).curve
    return curve.auc, curve.recall_at_100_precision
