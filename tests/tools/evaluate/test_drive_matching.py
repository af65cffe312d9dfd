"""Matching the descriptors of a drive, on frames that are images."""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import Config, MatchingConfig, Rule
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.recognizer import Recognizer
from placefield_tools.evaluate.drive_matching import (
    Matches,
    Metres,
    RawFeature,
    descriptors_of,
    match_drive,
)
from placefield_tools.evaluate.evaluation import describe_query
from placefield_tools.sources import open_source

UNKNOWN: list[float | None] = [None] * 60
"""The odometry of a query that has none."""


def raws_of(placemap: Map, folder: Path) -> list[NDArray[np.float32]]:
    with open_source(str(folder)) as source:
        described, _, _ = describe_query(source, feature_of_model(placemap.model).of_frame)
    return [raw for raw in described if raw is not None]


def matched(
    placemap: Map,
    raws: Sequence[RawFeature],
    readings: Sequence[float | None],
    config: MatchingConfig,
    lags: Collection[int] = (),
) -> Matches:
    descriptors = descriptors_of(placemap.model, raws)
    return match_drive(placemap.channels, descriptors, Metres(placemap, readings), config, lags)


@pytest.mark.parametrize("rule", get_args(Rule))
def test_a_query_is_matched_as_the_recognizer_matches_its_files(
    route_map: Map, damaged_query: Path, rule: Rule
) -> None:
    config = MatchingConfig(rule=rule)
    recognizer = Recognizer(route_map, Config(matching=config))
    files = sorted(damaged_query.iterdir())
    with open_source(str(damaged_query)) as source:
        raws, readings, _ = describe_query(source, feature_of_model(route_map.model).of_frame)
    matches = matched(route_map, raws, readings, config, [config.lag])
    assert matches.causal == [recognizer.update(file.read_bytes()) for file in files]
    assert matches.smoothed == {config.lag: recognizer.finish()}


@pytest.mark.parametrize("rule", get_args(Rule))
def test_frames_are_compared_once_for_all_lags_of_a_rule(
    route_map: Map, query_dir: Path, rule: Rule, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared: list[Comparison] = []
    compare = MetricPlaces.compare

    def counting(self: MetricPlaces, descriptors: NDArray[np.float32]) -> Iterator[Comparison]:
        for comparison in compare(self, descriptors):
            compared.append(comparison)
            yield comparison

    monkeypatch.setattr(MetricPlaces, "compare", counting)
    config = MatchingConfig(rule=rule)
    matched(route_map, raws_of(route_map, query_dir), UNKNOWN, config, [10, 20, WHOLE_DRIVE])
    assert len(compared) == 60  # all channels have one metric


@pytest.mark.parametrize("rule", get_args(Rule))
@pytest.mark.parametrize("end", [12, 31, 45])
def test_a_smoothed_match_looks_at_no_frame_later_than_its_lag(
    route_map: Map, query_dir: Path, rule: Rule, end: int
) -> None:
    noise = np.random.default_rng(3).normal(scale=0.1, size=(60, 512)).astype(np.float32)
    raws = [raw + noise[n, : len(raw)] for n, raw in enumerate(raws_of(route_map, query_dir))]
    lags = (1, 5, 10, 20)
    config = MatchingConfig(rule=rule)
    whole = matched(route_map, raws, UNKNOWN, config, [*lags, WHOLE_DRIVE])
    cut = matched(route_map, raws[: end + 1], UNKNOWN[: end + 1], config, lags)
    for lag in lags:
        smoothed = whole.smoothed[lag]
        assert [each.frame for each in smoothed] == [*range(60)]
        assert all(each.lag <= min(lag, 59 - each.frame) for each in smoothed)
        reported = max(end + 1 - lag, 0)
        assert cut.smoothed[lag][:reported] == smoothed[:reported]
    assert cut.causal == whole.causal[: end + 1]


def test_in_hindsight_every_frame_waits_for_the_end(route_map: Map, query_dir: Path) -> None:
    raws = raws_of(route_map, query_dir)
    hindsight = matched(route_map, raws, UNKNOWN, MatchingConfig(), [WHOLE_DRIVE])
    smoothed = hindsight.smoothed[WHOLE_DRIVE]
    assert [each.lag for each in smoothed] == [*range(59, -1, -1)]
    # The last frame has none after it, so that there is nothing to smooth.
    causal = matched(route_map, raws, UNKNOWN, MatchingConfig()).causal[-1]
    assert smoothed[-1].match.place == causal.place
    assert smoothed[-1].match.probability == pytest.approx(causal.probability)


@pytest.mark.parametrize("rule", get_args(Rule))
@pytest.mark.parametrize("reverse", [False, True])
def test_a_drive_is_matched_with_several_lags_as_with_each_alone(
    route_map: Map, query_dir: Path, rule: Rule, reverse: bool
) -> None:
    raws: list[RawFeature] = [*raws_of(route_map, query_dir)]
    raws[20:23] = [None] * 3
    lags, config = (20, 5, 0, WHOLE_DRIVE), MatchingConfig(rule=rule, reverse=reverse)
    together = matched(route_map, raws, UNKNOWN, config, lags)
    assert list(together.smoothed) == [*lags]
    for lag in lags:
        alone = matched(route_map, raws, UNKNOWN, config, [lag])
        assert together.causal == alone.causal
        assert together.smoothed[lag] == alone.smoothed[lag]
    assert together.causal == matched(route_map, raws, UNKNOWN, config).causal
