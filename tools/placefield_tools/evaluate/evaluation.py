"""A query against a map: matches, figures, pictures."""

from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config, MatchingConfig, Rule
from placefield.errors import FrameError, SourceError
from placefield.evaluation.claims import Claims, claims
from placefield.evaluation.curves import PrecisionRecall, precision_recall
from placefield.evaluation.protocols import DEFAULT_EVERY, Drive, Protocol, aligned
from placefield.evaluation.reliability import Reliability, reliability
from placefield.evaluation.truth import Truth
from placefield.features.descriptor_stage import DescriptorStage
from placefield.features.extract import feature_of_model
from placefield.features.frames import Frame, Pose
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.matching.candidate import UNANSWERED
from placefield.matching.matcher import WHOLE_DRIVE
from placefield_tools.common.parallel import map_in_order
from placefield_tools.common.progress import CONSOLE, tracked
from placefield_tools.evaluate.drive_matching import Matches, Metres, match_drive
from placefield_tools.evaluate.through_services import match_through_services
from placefield_tools.evaluate.truth_source import Comparison, TruthOptions, TruthSource, find_truth
from placefield_tools.sources import NO_PARTS, Parts, Source, open_source
from placefield_tools.sources.resampled import ResampledTraverse

RULES: tuple[Rule, ...] = get_args(Rule)

LAGS = (10, 20)
"""Of the smoothed matches that are judged beside those with the lag in force."""

TruthOf = Callable[[int, int], Truth]

Description = TypeVar("Description")

RawFeature = NDArray[np.float32] | None
"""A frame's raw feature, (D,); None if the frame cannot be read."""


@dataclass(frozen=True)
class Judged:
    """The matches of a query of Q frames, and how right they are.

    Attributes:
        places: (Q,) int64, the match of each frame, -1 where there is none.
        scores: (Q,) float64, the higher the more certain.
        correct: (Q,) bool.
        curve: precision and recall.
        reliability: of the answers' probabilities, where the method gives them.
        claims: the matches that are known, likewise.
        mean_lag: how many frames after it a match looks at, on average.
        too_fast: of how many frames the vehicle is said to be faster than the map resolves.
    """

    places: NDArray[np.int64]
    scores: NDArray[np.float64]
    correct: NDArray[np.bool_]
    curve: PrecisionRecall
    reliability: Reliability | None = None
    claims: Claims | None = None
    mean_lag: float = 0.0
    too_fast: int = 0


@dataclass(frozen=True)
class Query:
    """Where a query's frames are, and how they are driven.

    Attributes:
        where: source of the frames.
        spacing_m: metres between them, by odometry; None: take every frame.
        protocol: how they are driven.
        other: source of the other route's frames, which only the protocol ``off-route`` takes.
        seed: of the protocol.
        parts: of both sources.
        every: n of a protocol that takes every n-th frame; None: its default.
    """

    where: str
    spacing_m: float | None = None
    protocol: Protocol = "aligned"
    other: str | None = None
    seed: int = 0
    parts: Parts = NO_PARTS
    every: int | None = None

    def open(self) -> Source:
        """Open the frames, in the order in which they are driven.

        Raises:
            SourceError: a source cannot be read, or is live and is to be driven again.
        """
        opened = partial(open_source, spacing_m=self.spacing_m, parts=self.parts)
        if self.protocol == "aligned":
            return opened(self.where)
        with ExitStack() as stack:
            query = stack.enter_context(opened(self.where))
            other = stack.enter_context(opened(self.other)) if self.other else None
            every = DEFAULT_EVERY if self.every is None else self.every
            return ResampledTraverse(query, self.protocol, other=other, seed=self.seed, every=every)

    def numbered(self, drive: Drive) -> Drive:
        """Return the drive by the numbers that its frames have in the query's source.

        Spaced frames have those of their own order.
        """
        if self.spacing_m is not None:
            return drive
        return replace(drive, frames=self.parts.start + self.parts.stride * drive.frames)

    def frames_in_source(self, taken: int) -> int:
        """Return how many frames its source has, of which so many are taken."""
        start, stride = self.parts.start, self.parts.stride
        whole = replace(self.parts, start=0, stop=None, stride=1)
        if self.spacing_m is not None or whole == self.parts:
            return taken
        with open_source(self.where, parts=whole) as source:
            last = start + stride * (taken - 1)
            return max(source.count or 0, last + 1)

    def matching(self, config: MatchingConfig) -> MatchingConfig:
        """Return how to match the driven frames: the protocol ``reverse`` turns the way round."""
        turned = config.reverse != (self.protocol == "reverse")
        return config.model_copy(update={"reverse": turned})


@dataclass(frozen=True)
class Evaluation:
    """A query that was matched and judged, and what it was matched against.

    Attributes:
        placemap: the map.
        query: the drive.
        raws: raw feature of each frame.
        lag: in force, frames.
        results: of each rule's causal matches; empty where nobody knows what is right.
        smoothed: of each rule's smoothed matches, by lag, ascending, the last one ``WHOLE_DRIVE``;
            empty where services have matched.
        ground: by what that is right.
        known: how many causal matches are known, of each rule that tells.
        missing: how many frames the query promised and has not.
    """

    placemap: Map
    query: Query
    raws: list[RawFeature]
    lag: int
    results: dict[Rule, Judged]
    smoothed: dict[Rule, dict[int, Judged]]
    ground: TruthSource
    known: dict[Rule, int]
    missing: int


def drive_in(source: Source, count: int) -> tuple[Drive, int]:
    """Return how a query's source drives, and how many frames the query has in its own order.

    Args:
        source: of ``Query.open``.
        count: of the frames that it gave.
    """
    if isinstance(source, ResampledTraverse):
        return source.drive, source.query_count
    return aligned(count), count


def describe_query(
    source: Source, describe: Callable[[NDArray[np.uint8]], Description]
) -> tuple[list[Description | None], list[float | None]]:
    """Describe the images of a query's frames, see ``describe_query_with_poses``."""
    descriptions, readings, _ = describe_query_with_poses(source, describe)
    return descriptions, readings


def describe_query_with_poses(
    source: Source, describe: Callable[[NDArray[np.uint8]], Description]
) -> tuple[list[Description | None], list[float | None], list[Pose | None]]:
    """Describe the images of a query's frames.

    Returns:
        The description of each frame, None for one that cannot be read, its odometry and its pose.

    Raises:
        SourceError: it is live or has no frame that can be read.
    """
    if source.live:
        raise SourceError("a camera cannot be evaluated; record it and give the recording")

    unreadable: dict[int, str] = {}

    def describe_frame(frame: Frame) -> tuple[Description | None, float | None, Pose | None]:
        try:
            return describe(frame.pixels()), frame.odometry_m, frame.pose
        except FrameError as error:
            unreadable[frame.index] = f"query frame {frame.name}: {error}"
            return None, frame.odometry_m, frame.pose

    with tracked(source, "describing the query", source.count) as frames:
        each = list(map_in_order(describe_frame, frames))
    described = [description for description, _, _ in each]
    for _, reason in sorted(unreadable.items()):
        CONSOLE.print(f"{reason}; matched as a frame not seen", soft_wrap=True)
    if all(description is None for description in described):
        raise SourceError("the query has no frame that can be read")
    return described, [reading for _, reading, _ in each], [pose for _, _, pose in each]


def match_here(
    placemap: Map,
    raws: Sequence[RawFeature],
    readings: Sequence[float | None],
    config: MatchingConfig,
    lags: Collection[int] = (),
) -> Matches:
    """Match a query's frames in this process, and smooth with these lags; see ``match_drive``."""
    images = DescriptorStage(placemap.model).new_stream()
    descriptors = [None if raw is None else images.update_raw(raw) for raw in raws]
    metres = Metres(placemap.places, readings)
    return match_drive(placemap.channels, descriptors, metres, config, lags)


def judge(matches: Sequence[Match], truth: Truth) -> Judged:
    """Compare matches with the truth, in the frames that it judges."""
    places = np.array([match.place for match in matches], np.int64)
    scores = np.array([match.score for match in matches], np.float64)
    correct = truth.correct(places)
    answered = places != UNANSWERED
    judged = slice(None) if truth.judged is None else truth.judged
    on_route = truth.on_route[judged]
    curve = precision_recall(correct[judged], answered[judged], on_route, scores[judged])
    if not any(match.known is not None for match in matches):
        return Judged(places, scores, correct, curve)
    probability = np.array([match.probability or 0.0 for match in matches])
    known = np.array([bool(match.known) for match in matches])
    return Judged(
        places,
        scores,
        correct,
        curve,
        reliability(probability[judged][answered[judged]], correct[judged][answered[judged]]),
        claims(known[judged], correct[judged], on_route),
        too_fast=sum(match.too_fast for match in matches),
    )


def judge_smoothed(matches: Sequence[SmoothedMatch], truth: Truth) -> Judged:
    """Compare smoothed matches with the truth, frame by frame."""
    judged = judge([smoothed.match for smoothed in matches], truth)
    return replace(judged, mean_lag=float(np.mean([smoothed.lag for smoothed in matches])))


def evaluate(
    map_path: Path,
    query: Query,
    truth_of: TruthOf,
    config: Config,
    *,
    services: bool,
    asked: TruthOptions | None = None,
) -> Evaluation:
    """Match a query against a map by every rule that serves, and judge causal and smoothed matches.

    Args:
        map_path: the map.
        query: to match, by a protocol that leaves the map's places as they are.
        truth_of: gives the truth for so many query frames, in their own order, and places.
        config: its matching, fusion and bus.
        services: whether the frames are matched by the services, as processes on a bus of their
            own, and not in this process.
        asked: what else says what is right, see ``find_truth``. Where nobody knows, only the rule
            that tells which matches are known is run, and nothing is judged.

    Raises:
        PlacefieldError: the map, the query or the truth cannot be read, or the services fail.
    """
    placemap = open_map(map_path)
    lag = config.matching.lag
    lags = [*sorted({*LAGS, lag} - {0}), WHOLE_DRIVE]
    results: dict[Rule, Judged] = {}
    smoothed: dict[Rule, dict[int, Judged]] = {}
    known: dict[Rule, int] = {}
    with query.open() as source:
        describe = feature_of_model(placemap.model).describe
        raws, readings, poses = describe_query_with_poses(source, describe)
        drive, undriven = drive_in(source, len(raws))
        count, queries = placemap.places.count, query.frames_in_source(undriven)
        ground = find_truth(
            Comparison(
                placemap, count, queries, query.numbered(drive), poses, source.origin, readings
            ),
            lambda: truth_of(queries, count),
            asked,
        )
        rules = RULES if ground.truth is not None else ("filter",)
        for rule in filter(placemap.features.serve, rules):
            matching = query.matching(config.matching).model_copy(update={"rule": rule})
            if services:
                ruled = config.model_copy(update={"matching": matching})
                causal, of_lag = match_through_services(map_path, source, ruled)
                matches = Matches(causal, {lag: of_lag} if lag else {})
            else:
                matches = match_here(placemap, raws, readings, matching, lags)
            if any(match.known is not None for match in matches.causal):
                known[rule] = sum(bool(match.known) for match in matches.causal)
            if ground.truth is None:
                continue
            results[rule] = judge(matches.causal, ground.truth)
            smoothed[rule] = {
                each: judge_smoothed(of_lag, ground.truth)
                for each, of_lag in matches.smoothed.items()
            }
        missing = source.not_given["missing"]
    return Evaluation(placemap, query, raws, lag, results, smoothed, ground, known, missing)
