from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from placefield.baselines.fabmap import fabmap, learn_tree
from placefield.baselines.fixed_window import fixed_window
from placefield.baselines.multiscale import fixed_scale_channels
from placefield.baselines.seqslam import seqslam
from placefield.config import Config, Rule
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.loading import load_config
from placefield.maps.map import Map
from placefield.maps.map_metrics import identity_metric
from placefield.matching.comparing import MetricPlaces
from placefield.matching.evidence import EvidenceMatcher
from placefield.matching.window_matcher import MeanDistance, ShardPlaces
from placefield.recognizer import Recognizer
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.evaluate.judging import judge
from placefield_tools.study.methods import PUBLISHED_LAG, methods_of, run_methods
from placefield_tools.study.results import MethodResult
from placefield_tools.study.trial import Trial


@pytest.fixture(scope="module")
def results(trial: Trial) -> dict[str, MethodResult]:
    return {result.name: result for result in run_methods(trial, methods_of(trial))}


def with_lag(trial: Trial, lag: int) -> Trial:
    matching = trial.config.matching.model_copy(update={"lag": lag})
    return replace(trial, config=trial.config.model_copy(update={"matching": matching}))


def assert_matches(result: MethodResult, matches: list[Match]) -> None:
    assert result.judged is not None
    assert result.judged.places.tolist() == [match.place for match in matches]
    assert result.judged.scores.tolist() == [match.score for match in matches]


@pytest.mark.parametrize("rule", ["filter", "evidence", "ams"])
def test_ours_are_the_recognizers_matches(
    trial: Trial, results: dict[str, MethodResult], rule: Rule
) -> None:
    recognizer = Recognizer(trial.placemap, Config(matching=trial.matching(rule)))
    name = "AMS, published rule" if rule == "ams" else f"Placefield, {rule}"
    assert_matches(results[name], [recognizer.update_raw(raw) for raw in trial.query.raws])
    assert results[name].ours == (rule != "ams")


@pytest.mark.parametrize("rule", ["filter", "evidence", "ams"])
def test_with_a_lag_they_are_its_smoothed_ones(
    trial: Trial, results: dict[str, MethodResult], rule: Rule
) -> None:
    recognizer = Recognizer(trial.placemap, Config(matching=trial.matching(rule)))
    for raw in trial.query.raws:
        recognizer.update_raw(raw)
    smoothed = recognizer.finish()
    name = "AMS, published rule" if rule == "ams" else f"Placefield, {rule}"
    result = results[f"{name}, lag 20"]
    assert_matches(result, [each.match for each in smoothed])
    assert result.judged is not None
    assert result.judged.mean_lag == np.mean([each.lag for each in smoothed]) <= result.lag == 20


def test_the_lag_is_the_one_in_force(trial: Trial) -> None:
    assert {method.lag for method in methods_of(with_lag(trial, 7))} == {0, 7, PUBLISHED_LAG}
    assert {method.name for method in methods_of(with_lag(trial, 7)) if method.ours} == {
        f"Placefield, {rule}{lag}" for rule in ("evidence", "filter") for lag in ("", ", lag 7")
    }


@pytest.mark.parametrize(("lag", "looked_at"), [(2, 2), (20, 4)])
def test_a_window_looks_at_half_its_length_at_most(trial: Trial, lag: int, looked_at: int) -> None:
    lagging = with_lag(trial, lag)
    (window,) = [m for m in methods_of(lagging) if m.name == f"window of 8, lag {lag}"]
    assert window.match(lagging).mean_lag == looked_at


@pytest.mark.parametrize(("name", "lag"), [("window of 8", 0), ("window of 8, lag 20", 20)])
def test_windows_compare_descriptors(
    trial: Trial, results: dict[str, MethodResult], name: str, lag: int
) -> None:
    query = np.stack([vector for vector in trial.descriptors if vector is not None])
    places = trial.placemap.model.of_reference(trial.traverse.raw)
    distances = ((query[:, None].astype(float) - places[None]) ** 2).sum(axis=2)
    expected = fixed_window(distances.astype(np.float32), 8, lag)
    judged = results[name].judged
    assert results[name].lag == lag
    assert judged is not None
    assert judged.places.tolist() == [match.place for match in expected]
    np.testing.assert_allclose(judged.scores, [match.score for match in expected], atol=2e-3)


def test_windows_by_evidence_are_our_windows_of_one_length(
    trial: Trial, results: dict[str, MethodResult]
) -> None:
    query = np.stack([vector for vector in trial.descriptors if vector is not None])
    frames = MetricPlaces(trial.plain.metric, exact=True).compare(query)
    metric, every = trial.plain.metric, slice(0, len(trial.plain.metric.places))
    whole = ShardPlaces(len(metric.places), every, every)
    matcher = EvidenceMatcher([8], whole, metric.unit, MeanDistance(metric), lags=[0])
    config = trial.matching("evidence")
    matches = [fuse([matcher.update(frame)], config) for frame in frames]
    assert_matches(results["window of 8, evidence"], matches)


def test_baselines_are_what_they_are_by_themselves(
    trial: Trial, results: dict[str, MethodResult]
) -> None:
    reference, query = trial.reference, trial.query
    assert_matches(results["SeqSLAM"], seqslam(reference.images, query.images))
    assert_matches(results["SeqSLAM, lag 20"], seqslam(reference.images, query.images, lag=20))
    tree = learn_tree(reference.words)
    assert_matches(results["FAB-MAP"], fabmap(reference.words, query.words, tree))


def test_ms_has_the_fixed_scales_that_fit(trial: Trial, results: dict[str, MethodResult]) -> None:
    built = trial.multiscale
    expected = fixed_scale_channels(60, (6, 12, 24))
    scales = [channel.scales.tolist() for channel in built.channels]
    assert scales == [channel.encoding.scales.tolist() for channel in expected]
    assert {channel.smallest for channel in built.channels} == {6}
    assert_matches(results["MS"], published_matches(trial, built))


def test_ams_as_published_is_the_preset_whatever_the_settings_of_our_map(
    trial: Trial, results: dict[str, MethodResult], reference_dir: Path
) -> None:
    preset = load_config(None, {"preset": "paper", "scales": {"channels": 2}})
    built = build_from([str(reference_dir)], preset)
    assert trial.published.model.plain
    assert not trial.placemap.model.plain
    for channel, other in zip(trial.published.channels, built.channels, strict=True):
        np.testing.assert_array_equal(channel.labels, other.labels)
        np.testing.assert_array_equal(channel.metric.projection, other.metric.projection)
    assert_matches(results["AMS as published"], published_matches(trial, built))


def published_matches(trial: Trial, built: Map) -> list[Match]:
    """The smoothed matches of a recognizer by the preset, by windows of any length."""
    recognizer = Recognizer(built, load_config(None, {"preset": "paper"}))
    for raw in trial.query.raws:
        recognizer.update_raw(raw)
    return [each.match for each in recognizer.finish()]


def test_the_oracles_are_the_best_windows_of_each_lag(results: dict[str, MethodResult]) -> None:
    windows = [r for r in results.values() if r.name.startswith("window") and r.judged]
    for lag, count in ((0, 10), (20, 5)):
        merits = {
            r.name: (r.judged.curve.auc, r.judged.curve.recall_at_100_precision)
            for r in windows
            if r.lag == lag and r.judged
        }
        assert len(merits) == count
        (oracle,) = [r.name for r in windows if r.oracle and r.lag == lag]
        assert merits[oracle] == max(merits.values())
    assert sum(r.oracle for r in results.values()) == 2


def test_windows_that_are_longer_than_the_drive_are_left_out(trial: Trial) -> None:
    short = replace(trial, descriptors=trial.descriptors[:20])
    windows = {method.name for method in methods_of(short) if method.is_window}
    ways = ("", ", evidence", ", lag 20")
    assert windows == {f"window of {n}{way}" for way in ways for n in (4, 8, 16)}


def test_without_a_lag_none_looks_ahead_but_what_is_published_so(trial: Trial) -> None:
    without, all_methods = methods_of(with_lag(trial, 0)), methods_of(trial)
    assert {method.lag for method in without} == {0, PUBLISHED_LAG}
    assert [m.name for m in all_methods if m.lag != 20] == [m.name for m in without]
    looking = {m.name for m in without if m.lag}
    assert looking == {"MS", "AMS as published"}


def test_in_reverse_every_method_finds_what_it_finds_on_a_turned_reference(
    reverse_trial: Trial,
) -> None:
    placemap = reverse_trial.placemap
    places = placemap.model.of_reference(reverse_trial.traverse.raw)
    metric = identity_metric(places[::-1])  # of a single traverse none is learned
    turned_channels = tuple(replace(channel, metric=metric) for channel in placemap.channels)
    reference = reverse_trial.reference
    turned = replace(
        reverse_trial,
        config=reverse_trial.config.model_copy(
            update={"matching": reverse_trial.config.matching.model_copy(update={"reverse": False})}
        ),
        placemap=replace(placemap, channels=turned_channels),
        plain=replace(reverse_trial.plain, metric=metric),
        reference=replace(reference, images=reference.images[::-1]),
    )
    for method in methods_of(reverse_trial):
        if method.name.startswith(("MS", "AMS as published", "FAB-MAP")):
            continue  # built anew; in any order
        by_name = {other.name: other for other in methods_of(turned)}
        back = method.match(reverse_trial).matches
        forth = by_name[method.name].match(turned).matches
        assert [m.place for m in back] == [59 - m.place if m.place >= 0 else -1 for m in forth]


def test_in_reverse_the_route_is_recognised(reverse_trial: Trial) -> None:
    for method in methods_of(reverse_trial):
        if method.name != "FAB-MAP" and "window of 52" not in method.name:
            judged = judge(method.match(reverse_trial).matches, reverse_trial.truth)
            last = slice(36, 41) if method.lag else slice(-5, None)
            assert judged.correct[last].all(), method.name


def test_a_method_that_fails_says_why_and_the_others_go_on(
    trial: Trial, results: dict[str, MethodResult]
) -> None:
    wordless = replace(trial.reference, words=np.empty((60, 0), np.bool_))
    failed = {r.name: r for r in run_methods(replace(trial, reference=wordless), methods_of(trial))}
    assert failed["FAB-MAP"].judged is None
    assert "no keypoint" in (failed["FAB-MAP"].failure or "")
    assert all(r.judged is not None for name, r in failed.items() if name != "FAB-MAP")


def test_frames_that_were_not_seen_are_matched_all_the_same(trial: Trial) -> None:
    raws = [None if frame in (0, 20, 21) else raw for frame, raw in enumerate(trial.query.raws)]
    vectors = [None if raw is None else d for raw, d in zip(raws, trial.descriptors, strict=True)]
    gaps = replace(trial, query=replace(trial.query, raws=raws), descriptors=vectors)
    for result in run_methods(gaps, methods_of(gaps)):
        assert result.judged is not None, result.failure
        assert np.isfinite(result.judged.scores).all()
        if result.name in ("window of 8", "SeqSLAM", "Placefield, filter"):
            assert result.judged.correct[40:].all()


def test_a_query_of_which_no_frame_was_seen_has_no_match(trial: Trial) -> None:
    """By our methods, that is."""
    unseen: list[None] = [None] * 60
    blind = replace(trial, query=replace(trial.query, raws=unseen), descriptors=unseen)
    for method in methods_of(blind):
        if method.ours:
            assert {match.place for match in method.match(blind).matches} == {-1}, method.name
