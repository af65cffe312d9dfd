"""A query against a map: matches, figures, pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config, MatchingConfig, Rule
from placefield.errors import FrameError, SourceError
from placefield.evaluation.curves import PrecisionRecall, precision_recall
from placefield.evaluation.truth import Truth
from placefield.features.extract import raw_feature
from placefield.features.frames import Frame
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.maps.store import open_map
from placefield.matching.candidate import UNANSWERED
from placefield.recognizer import Recognizer
from placefield_tools.parallel import map_in_order
from placefield_tools.progress import CONSOLE, tracked
from placefield_tools.sources import Source, open_source
from placefield_tools.streaming import match_through_services

RULES: tuple[Rule, ...] = get_args(Rule)

TruthOf = Callable[[int, int], Truth]

RawFeature = NDArray[np.float32] | None
"""A frame's raw feature, (D,); None if the frame cannot be read."""


@dataclass(frozen=True)
class RuleResult:
    """What one rule made of a query of Q frames.

    Attributes:
        places: (Q,) int64, the match of each frame, -1 where there is none.
        scores: (Q,) float64, the higher the more certain.
        correct: (Q,) bool.
        curve: precision and recall.
    """

    places: NDArray[np.int64]
    scores: NDArray[np.float64]
    correct: NDArray[np.bool_]
    curve: PrecisionRecall


@dataclass(frozen=True)
class Evaluation:
    """A query that was matched and judged, and what it was matched against."""

    placemap: Map
    query: str
    raws: list[RawFeature]
    results: dict[Rule, RuleResult]


def describe_query(source: Source, placemap: Map) -> list[RawFeature]:
    """Return the raw features of a query's frames.

    Raises:
        SourceError: it is live or has no frame that can be read.
    """
    if source.live:
        raise SourceError("a camera cannot be evaluated; record it and give the recording")

    unreadable: dict[int, str] = {}

    def describe(frame: Frame) -> RawFeature:
        try:
            return raw_feature(frame.image, placemap.model.kind)
        except FrameError as error:
            unreadable[frame.index] = f"query frame {frame.name}: {error}"
            return None

    raws = list(map_in_order(describe, tracked(source, "describing the query", source.count)))
    for _, reason in sorted(unreadable.items()):
        CONSOLE.print(f"{reason}; matched as a frame not seen", soft_wrap=True)
    if all(raw is None for raw in raws):
        raise SourceError("the query has no frame that can be read")
    return raws


def match_here(placemap: Map, raws: Sequence[RawFeature], config: MatchingConfig) -> list[Match]:
    """Match a query's frames in this process."""
    recognizer = Recognizer(placemap, config)
    return [recognizer.push_raw(raw) for raw in raws]


def judge(matches: Sequence[Match], truth: Truth) -> RuleResult:
    """Compare matches with the truth."""
    places = np.array([match.place for match in matches], np.int64)
    scores = np.array([match.score for match in matches], np.float64)
    correct = truth.correct(places)
    curve = precision_recall(correct, places != UNANSWERED, truth.on_route, scores)
    return RuleResult(places, scores, correct, curve)


def evaluate(
    map_path: Path, query: str, truth_of: TruthOf, config: Config, *, services: bool
) -> Evaluation:
    """Match a query against a map by every rule, and judge the matches.

    Args:
        map_path: the map.
        query: source of the query's frames.
        truth_of: gives the truth for so many query frames and places.
        config: its matching, fusion and bus.
        services: whether the frames are matched by the services, as processes on a bus of their
            own, and not in this process.

    Raises:
        PlacefieldError: the map, the query or the truth cannot be read, or the services fail.
    """
    placemap = open_map(map_path)
    results = {}
    with open_source(query) as source:
        raws = describe_query(source, placemap)
        truth = truth_of(len(raws), placemap.places.count)
        for rule in RULES:
            matching = config.matching.model_copy(update={"rule": rule})
            if services:
                ruled = config.model_copy(update={"matching": matching})
                matches = match_through_services(map_path, source, ruled)
            else:
                matches = match_here(placemap, raws, matching)
            results[rule] = judge(matches, truth)
    return Evaluation(placemap, query, raws, results)
