"""Every method on one trial."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.baselines.fabmap import fabmap, learn_tree
from placefield.baselines.fixed_window import fixed_window
from placefield.baselines.seqslam import PUBLISHED, image_differences, match_sequences
from placefield.config import Rule
from placefield.errors import MapError, PlacefieldError
from placefield.evaluation.protocols import frames_to_recover
from placefield.fusion.match import Match
from placefield.maps.map import Map, MapChannel
from placefield.matching.candidate import UNANSWERED
from placefield.presets import PRESETS
from placefield_tools.common.progress import tracked
from placefield_tools.evaluate.drive_matching import match_drive
from placefield_tools.evaluate.judging import judge
from placefield_tools.study.matching import match_channels, with_scales
from placefield_tools.study.results import MethodResult
from placefield_tools.study.trial import Trial

WINDOWS = (4, 8, 16, 32, 52)
"""Lengths of the fixed windows, frames."""

PUBLISHED_LAG: int = PRESETS["paper"]["matching"]["lag"]
"""Frames after the query that the windows of the AMS paper use: as many as their length."""


class Matched(NamedTuple):
    """A method's matches, and the mean number of later frames that a match uses."""

    matches: list[Match]
    mean_lag: float = 0.0


Matcher = Callable[[Trial], Matched]


@dataclass(frozen=True)
class Method:
    """A way to match a trial's frames.

    Attributes:
        name: for a person.
        match: the way.
        ours: whether it is Placefield's own.
        is_window: whether it is one fixed window.
        lag: how many frames after the matched one it may look at, at most.
    """

    name: str
    match: Matcher
    ours: bool = False
    is_window: bool = False
    lag: int = 0


def methods_of(trial: Trial) -> list[Method]:
    """Return all methods, with the windows that fit the route.

    Methods that can use later frames run a second time with the configured lag, unless it is 0. MS
    and AMS as published have the windows of the paper, which all use later frames.
    """
    lag = trial.config.matching.lag
    lengths = [n for n in WINDOWS if n <= min(len(trial.descriptors), trial.places)]
    return [
        Method("one frame", partial(_window, length=1)),
        *(Method(f"window of {n}", partial(_window, length=n), is_window=True) for n in lengths),
        *(
            Method(
                f"window of {n}, evidence",
                partial(_window_by_evidence, length=n),
                is_window=True,
            )
            for n in lengths
        ),
        Method("SeqSLAM", _seqslam),
        *(_with_lag(lengths, lag) if lag else []),
        Method("FAB-MAP", _fabmap),
        Method("MS", partial(_published, map_of=lambda trial: trial.multiscale), lag=PUBLISHED_LAG),
        Method(
            "AMS as published",
            partial(_published, map_of=lambda trial: trial.published),
            lag=PUBLISHED_LAG,
        ),
        *_by_channels(0),
        *(_by_channels(lag) if lag else []),
    ]


def _by_channels(lag: int) -> list[Method]:
    """Return the methods that match by channels: at a lag of 0 at once, else smoothed."""
    named = f", lag {lag}" if lag else ""
    lowest, evidence, filtered = (
        partial(_channels, rule=rule, lag=lag) for rule in ("ams", "evidence", "filter")
    )
    return [
        Method(f"AMS, published rule{named}", lowest, lag=lag),
        Method(f"Placefield, evidence{named}", evidence, ours=True, lag=lag),
        Method(f"Placefield, filter{named}", filtered, ours=True, lag=lag),
    ]


def _with_lag(lengths: Sequence[int], lag: int) -> list[Method]:
    """Return the methods that also run with a lag."""
    windows = [
        Method(f"window of {n}, lag {lag}", partial(_window, length=n, lag=lag), False, True, lag)
        for n in lengths
    ]
    return [*windows, Method(f"SeqSLAM, lag {lag}", partial(_seqslam, lag=lag), lag=lag)]


def run_methods(trial: Trial, methods: Sequence[Method]) -> tuple[MethodResult, ...]:
    """Run and judge methods, showing progress; a method that fails does not stop the others.

    The best window is chosen separately for each lag.
    """
    with tracked(methods, "matching by every method", len(methods)) as in_turn:
        results = [_run(method, trial) for method in in_turn]
    windows = [r for m, r in zip(methods, results, strict=True) if m.is_window and r.judged]
    best: dict[int, MethodResult] = {}
    for window in windows:
        best[window.lag] = max(best.get(window.lag, window), window, key=_merit)
    return tuple(replace(result, oracle=result is best.get(result.lag)) for result in results)


def _run(method: Method, trial: Trial) -> MethodResult:
    named = MethodResult(method.name, method.ours, False, None, None, None, method.lag)
    try:
        matches, mean_lag = method.match(trial)
        judged = replace(judge(matches, trial.truth), mean_lag=mean_lag)
    except PlacefieldError as error:
        return replace(named, failure=str(error))
    recovery = frames_to_recover(trial.jumps, judged.correct)
    median = float(np.median(recovery)) if len(recovery) else None
    return replace(named, judged=judged, frames_to_recover=median)


def _merit(result: MethodResult) -> tuple[float, float]:
    assert result.judged is not None
    curve = result.judged.curve
    return curve.auc, curve.recall_at_100_precision


def _window(trial: Trial, length: int, lag: int = 0) -> Matched:
    distances = _in_driving_order(_fill_missing_observations(trial.distances, trial), trial)
    matches = fixed_window(distances, length, lag)
    return Matched(_turned_back(matches, trial), min(lag, length // 2))


def _window_by_evidence(trial: Trial, length: int) -> Matched:
    channel = with_scales(trial.plain, [length])
    matching = trial.matching("evidence")
    return Matched(match_channels([channel], trial.descriptors, trial.metres, matching))


def _seqslam(trial: Trial, lag: int = 0) -> Matched:
    if not trial.reference.images.size:
        raise MapError("the frames are descriptors, and SeqSLAM compares images")
    differences = image_differences(trial.reference.images, trial.query.images, PUBLISHED.patch)
    differences = _in_driving_order(_fill_missing_observations(differences, trial), trial)
    matches = match_sequences(differences, lag=lag)
    return Matched(_turned_back(matches, trial), min(lag, PUBLISHED.length // 2))


def _fabmap(trial: Trial) -> Matched:
    reference = trial.reference.words
    if not trial.reference.images.size:
        raise MapError("the frames are descriptors, and FAB-MAP looks for keypoints in images")
    if not reference.size:
        raise MapError("the reference's frames have no keypoint, so FAB-MAP has no words")
    tree = learn_tree(reference)
    return Matched(fabmap(reference, trial.query.words, tree, seed=trial.config.seed))


def _published(trial: Trial, map_of: Callable[[Trial], Map]) -> Matched:
    placemap = map_of(trial)
    on_map = trial.on_published(placemap)
    return match_smoothed(placemap.channels, on_map, "ams", PUBLISHED_LAG)


def _channels(trial: Trial, rule: Rule, lag: int) -> Matched:
    channels = trial.placemap.channels
    if lag:
        return match_smoothed(channels, trial, rule, lag)
    matching = trial.matching(rule)
    return Matched(match_channels(channels, trial.descriptors, trial.metres, matching))


def match_smoothed(channels: Sequence[MapChannel], trial: Trial, rule: Rule, lag: int) -> Matched:
    """Match a trial's frames by some channels of a map of its descriptors, so many frames later."""
    matching = trial.matching(rule)
    matches = match_drive(channels, trial.descriptors, trial.metres, matching, [lag])
    smoothed = matches.smoothed[lag]
    mean_lag = float(np.mean([each.lag for each in smoothed]))
    return Matched([each.match for each in smoothed], mean_lag)


PUBLISHED_RIVALS = (
    Method("SeqSLAM", partial(_seqslam, lag=PUBLISHED.length // 2), lag=PUBLISHED.length // 2),
    Method("FAB-MAP", _fabmap),
)
"""The methods that the AMS paper compares with, besides MS; SeqSLAM has centred trajectories."""


def _fill_missing_observations(distances: NDArray[np.float32], trial: Trial) -> NDArray[np.float32]:
    """Give a missing observation the mean distance of the other frames to every place."""
    observed = trial.query.observed
    mean = distances[observed].mean() if observed.any() else np.float32(0)
    return np.where(observed[:, None], distances, mean)


def _in_driving_order(distances: NDArray[np.float32], trial: Trial) -> NDArray[np.float32]:
    """Put the places in the driving order of the route."""
    return distances[:, ::-1] if trial.config.matching.reverse else distances


def _turned_back(matches: list[Match], trial: Trial) -> list[Match]:
    """Convert the places of matches from the driving order to the order of the map."""
    if not trial.config.matching.reverse:
        return matches
    last = trial.places - 1
    return [m if m.place == UNANSWERED else replace(m, place=last - m.place) for m in matches]
