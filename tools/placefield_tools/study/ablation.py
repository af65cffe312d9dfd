"""Ablation: leaves out one part of the method at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from placefield.config import Rule
from placefield.maps.map import MapChannel
from placefield_tools.common.progress import tracked
from placefield_tools.evaluate.drive_matching import match_drive
from placefield_tools.evaluate.judging import judge, judge_smoothed
from placefield_tools.study.matching import median_scale, with_scales
from placefield_tools.study.results import AblationResult, LeftOut
from placefield_tools.study.trial import Trial

ABLATED_RULES: tuple[Rule, ...] = ("filter", "evidence")
FIXED_SCALES = (8, 16, 32, 52)
"""Lengths for all channels in place of the adaptive ones, in frames."""


def ablate(trial: Trial) -> tuple[AblationResult, ...]:
    """Match and judge without each part, by both of our rules, showing progress.

    Without a lag, and with the configured lag unless it is 0.
    """
    variants = variants_of(trial)
    runs = [(rule, part, channels) for rule in ABLATED_RULES for part, channels in variants.items()]
    with tracked(runs, "leaving parts out", len(runs)) as in_turn:
        return tuple(result for run in in_turn for result in _ablate(trial, *run))


def variants_of(trial: Trial) -> dict[LeftOut, Sequence[MapChannel]]:
    """Return the channels that are left without each part.

    Without several scales, a channel has its middle one; without adaptive ones, all channels have
    those of ``FIXED_SCALES``, no longer than the route; without the metric, if one was learned, the
    identity; without channels, the first is alone.
    """
    channels = trial.placemap.channels
    fixed = [min(scale, trial.places) for scale in FIXED_SCALES]
    variants: dict[LeftOut, Sequence[MapChannel]] = {
        "nothing": channels,
        "several scales": [with_scales(one, [median_scale(one)]) for one in channels],
        "adaptive scales": [with_scales(one, fixed) for one in channels],
        "channels": channels[:1],
    }
    if any(channel.metric.learned for channel in channels):
        variants["metric"] = [replace(one, metric=trial.plain.metric) for one in channels]
    return variants


def _ablate(
    trial: Trial, rule: Rule, part: LeftOut, channels: Sequence[MapChannel]
) -> Iterator[AblationResult]:
    matching = trial.matching(rule)
    lags = [matching.lag] if matching.lag else []
    matches = match_drive(channels, trial.descriptors, trial.metres, matching, lags)
    yield AblationResult(rule, part, 0, judge(matches.causal, trial.truth))
    for lag, smoothed in matches.smoothed.items():
        yield AblationResult(rule, part, lag, judge_smoothed(smoothed, trial.truth))
