"""Evaluating a query against a map: its matches are compared with a ground truth."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, get_args

from placefield.config import Config, Rule
from placefield.errors import FrameError, SourceError
from placefield.evaluation.protocols import Resampling, aligned
from placefield.evaluation.truth import Truth
from placefield.features.frames import Frame, Pose
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.verification.verification_stage import VerificationStage
from placefield_tools.common.parallel import map_in_order
from placefield_tools.common.progress import CONSOLE, tracked
from placefield_tools.evaluate.drive_matching import (
    Descriptors,
    Matches,
    Metres,
    descriptors_of,
    match_drive,
)
from placefield_tools.evaluate.judging import Judged, judge, judge_smoothed
from placefield_tools.evaluate.observing import observer
from placefield_tools.evaluate.query import Query
from placefield_tools.evaluate.through_services import match_through_services
from placefield_tools.evaluate.truth_source import TruthOptions, TruthSides, TruthSource, find_truth
from placefield_tools.evaluate.verified import verified_matches
from placefield_tools.sources import Source
from placefield_tools.sources.frame_content import check_frames, check_view, dimensions_of
from placefield_tools.sources.resampled import ResampledTraverse

RULES: tuple[Rule, ...] = get_args(Rule)

LAGS = (10, 20)
"""Lags of the smoothed matches that are evaluated besides the configured lag."""

TruthOf = Callable[[int, int], Truth]

Description = TypeVar("Description")


@dataclass(frozen=True)
class Evaluation:
    """A query, its map, and the evaluated matches.

    Attributes:
        placemap: the map.
        query: the drive.
        descriptors: of the query.
        unreadable: number of the query's frames that cannot be read.
        lag: the configured lag, frames.
        results: causal matches of each rule; empty without a ground truth.
        smoothed: smoothed matches of each rule, by ascending lag, the last one ``WHOLE_DRIVE``;
            only the configured lag if services matched.
        verified: smoothed matches of the configured lag after their verification; None if the map
            has no local features.
        ground: the ground truth and its source.
        known: number of known causal matches, of each rule that reports them.
        missing: number of missing frames of the query.
    """

    placemap: Map
    query: Query
    descriptors: Descriptors
    unreadable: int
    lag: int
    results: dict[Rule, Judged]
    smoothed: dict[Rule, dict[int, Judged]]
    verified: Judged | None
    ground: TruthSource
    known: dict[Rule, int]
    missing: int


def drive_in(source: Source, count: int) -> tuple[Resampling, int]:
    """Return the drive of a query's source, and the number of the query's frames.

    Args:
        source: opened by ``Query.open``.
        count: number of frames that it gave.
    """
    if isinstance(source, ResampledTraverse):
        return source.drive, source.query_count
    return aligned(count), count


def describe_query(
    source: Source, describe: Callable[[Frame], Description]
) -> tuple[list[Description | None], list[float | None], list[Pose | None]]:
    """Describe a query's frames.

    Returns:
        The description of each frame, None for one that cannot be read, its odometry and its pose.

    Raises:
        SourceError: the source is live, or no frame can be read.
    """
    if source.live:
        raise SourceError("a camera cannot be evaluated; record it and give the recording")

    unreadable: dict[int, str] = {}

    def describe_frame(frame: Frame) -> tuple[Description | None, float | None, Pose | None]:
        try:
            return describe(frame), frame.odometry_m, frame.pose
        except FrameError as error:
            unreadable[frame.index] = f"query frame {frame.name}: {error}"
            return None, frame.odometry_m, frame.pose

    with tracked(source, "describing the query", source.count) as frames:
        # A given descriptor costs less than its turn in a thread.
        run = map_in_order if source.dimensions is None else map
        each = list(run(describe_frame, frames))
    described = [description for description, _, _ in each]
    reasons = [reason for _, reason in sorted(unreadable.items())]
    if len(reasons) == len(each):
        raise SourceError("; ".join([*reasons[:1], "the query has no frame that can be read"]))
    for reason in reasons:
        CONSOLE.print(f"{reason}; matched as a missing observation", soft_wrap=True)
    return described, [reading for _, reading, _ in each], [pose for _, _, pose in each]


def evaluate(
    map_path: Path,
    query: Query,
    truth_of: TruthOf,
    config: Config,
    *,
    services: bool,
    asked: TruthOptions | None = None,
) -> Evaluation:
    """Match a query against a map by every rule that fits, and evaluate its matches.

    Args:
        map_path: the map.
        query: the drive.
        truth_of: gives the truth for these numbers of query frames, in their own order, and places.
        config: its matching, fusion and bus are used.
        services: whether services match the frames, as processes on a separate bus, and not this
            process.
        asked: the user's options for the truth, see ``find_truth``. Without a ground truth, only
            the rule that reports known matches runs, and nothing is evaluated.

    Raises:
        PlacefieldError: the map, the query or the truth cannot be read, or the services fail.
    """
    placemap = open_map(map_path)
    lag = config.matching.lag
    lags = [*sorted({*LAGS, lag} - {0}), WHOLE_DRIVE]
    results: dict[Rule, Judged] = {}
    smoothed: dict[Rule, dict[int, Judged]] = {}
    known: dict[Rule, int] = {}
    verified = None
    with query.open() as source:
        check_frames(source, query.where, dimensions_of(placemap.model), map_path.name)
        check_view(source, query.where, placemap.model.view)
        observe = observer(placemap, config.inference)
        observed, readings, poses = describe_query(source, observe)
        raws = [None if frame is None else frame.raw for frame in observed]
        descriptors, metres = descriptors_of(placemap.model, raws), Metres(placemap, readings)
        local = [None if frame is None else frame.local_features for frame in observed]
        drive, in_own_order = drive_in(source, len(raws))
        count, queries = placemap.places.count, query.frames_in_source(in_own_order)
        ground = find_truth(
            TruthSides(
                placemap, count, queries, query.numbered(drive), poses, source.origin, readings
            ),
            lambda: truth_of(queries, count),
            asked,
        )
        is_network = len(placemap.graph.names) > 1
        rules = RULES if ground.truth is not None and not is_network else ("filter",)
        for rule in filter(placemap.features.serve, rules):
            matching = query.matching(config.matching).model_copy(update={"rule": rule})
            if services:
                ruled = config.model_copy(update={"matching": matching})
                causal, of_lag = match_through_services(map_path, source, ruled)
                matches = Matches(causal, {lag: of_lag} if lag else {})
            else:
                matches = match_drive(placemap.channels, descriptors, metres, matching, lags)
            if any(match.known is not None for match in matches.causal):
                known[rule] = sum(bool(match.known) for match in matches.causal)
            if ground.truth is None:
                continue
            results[rule] = judge(matches.causal, ground.truth)
            smoothed[rule] = {
                each: judge_smoothed(of_lag, ground.truth)
                for each, of_lag in matches.smoothed.items()
            }
            if rule == "filter" and lag and placemap.local_features is not None:
                stage = VerificationStage(placemap, config)
                checked = verified_matches(stage, matches.smoothed[lag], local)
                verified = judge_smoothed(checked, ground.truth)
        missing = source.not_given["missing"]
    return Evaluation(
        placemap,
        query,
        descriptors,
        sum(raw is None for raw in raws),
        lag,
        results,
        smoothed,
        verified,
        ground,
        known,
        missing,
    )
