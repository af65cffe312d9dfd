from dataclasses import replace

import numpy as np
import pytest

from placefield.config import Config
from placefield.maps.map import MapChannel
from placefield.maps.map_metrics import learned_metric
from placefield.recognizer import Recognizer
from placefield_tools.evaluate.judging import judge
from placefield_tools.study.ablation import ablate
from placefield_tools.study.trial import Trial, descriptors_of


@pytest.fixture(scope="module")
def learned(trial: Trial) -> Trial:
    """The trial, had its map a metric, and were the query hard to recognise."""
    rng = np.random.default_rng(0)

    reference = trial.placemap.model.of_reference(trial.traverse.raw)

    def learn(channel: MapChannel) -> MapChannel:
        size = reference.shape[1]
        projection = np.eye(size) + 0.3 * rng.standard_normal((size, size))
        return replace(channel, metric=learned_metric(projection.astype(np.float32), reference))

    noise = 0.2 * rng.standard_normal((60, trial.traverse.raw.shape[1])).astype(np.float32)
    raws = [raw + added for raw, added in zip(trial.query.raws, noise, strict=True)]
    descriptors = descriptors_of(trial.placemap.model, raws)
    channels = tuple(learn(channel) for channel in trial.placemap.channels)
    return replace(
        trial,
        placemap=replace(trial.placemap, channels=channels),
        query=replace(trial.query, raws=raws),
        descriptors=descriptors,
    )


def test_each_part_is_left_out_of_the_map_and_all_else_stays(trial: Trial, learned: Trial) -> None:
    channels = learned.placemap.channels

    def scaled(channel: MapChannel, scales: list[int]) -> MapChannel:
        return replace(channel, scales=np.array(scales, np.int32))

    middle = [sorted(channel.scales.tolist())[len(channel.scales) // 2] for channel in channels]
    variants = {
        "nothing": channels,
        "several scales": [scaled(c, [s]) for c, s in zip(channels, middle, strict=True)],
        "adaptive scales": [scaled(channel, [8, 16, 32, 52]) for channel in channels],
        "channels": channels[:1],
        "metric": trial.placemap.channels,  # of a single traverse none is learned
    }
    results = ablate(learned)

    assert [(r.rule, r.left_out, r.lag) for r in results] == [
        (rule, part, lag) for rule in ("filter", "evidence") for part in variants for lag in (0, 20)
    ]
    for result in results:
        placemap = replace(learned.placemap, channels=tuple(variants[result.left_out]))
        recognizer = Recognizer(placemap, Config(matching=learned.matching(result.rule)))
        matches = [recognizer.update_raw(raw) for raw in learned.query.raws]
        smoothed = recognizer.finish()
        if result.lag:
            matches = [each.match for each in smoothed]
            assert result.judged.mean_lag == np.mean([each.lag for each in smoothed])
        expected = judge(matches, learned.truth)
        assert result.judged.scores.tolist() == expected.scores.tolist()
        assert result.judged.curve.auc == expected.curve.auc
        assert result.judged.claims == expected.claims


def test_no_two_parts_are_the_same(learned: Trial) -> None:
    results = [r for r in ablate(learned) if r.rule == "evidence" and not r.lag]
    assert len({result.judged.curve.auc for result in results}) == 5


def test_where_no_metric_was_learned_none_is_left_out(trial: Trial) -> None:
    assert "metric" not in {result.left_out for result in ablate(trial)}


def test_without_a_lag_nothing_is_smoothed(trial: Trial) -> None:
    matching = trial.config.matching.model_copy(update={"lag": 0})
    config = trial.config.model_copy(update={"matching": matching})
    assert {result.lag for result in ablate(replace(trial, config=config))} == {0}
