from dataclasses import replace
from math import comb

import pytest

from placefield.maps.map import Map
from placefield.recognizer import Recognizer
from placefield_tools.evaluate.judging import judge
from placefield_tools.study.paper.channel_count_runs import CHANNELS, combinations, count_channels
from placefield_tools.study.paper.paper_results import CountResult
from placefield_tools.study.trial import Trial


@pytest.fixture(scope="module")
def counts(paper_trial: Trial) -> tuple[CountResult, ...]:
    return count_channels(paper_trial)


def test_every_number_of_channels_is_combined(counts: tuple[CountResult, ...]) -> None:
    assert [count.channels for count in counts] == [*range(1, CHANNELS + 1)]
    for count in counts:
        tried = min(comb(CHANNELS, count.channels), 60)
        assert count.auc.shape == count.recall.shape == (tried,)


def test_all_channels_together_and_one_alone_are_maps_of_these_channels(
    paper_trial: Trial, counts: tuple[CountResult, ...]
) -> None:
    scales = paper_trial.config.scales.model_copy(update={"channels": CHANNELS})
    placemap = paper_trial.build(paper_trial.config.model_copy(update={"scales": scales}))
    assert all(channel.metric.learned for channel in placemap.channels)
    for number in (1, CHANNELS):
        curve = published_curve(paper_trial, replace(placemap, channels=placemap.channels[:number]))
        count = counts[number - 1]
        assert (count.auc[0], count.recall[0]) == curve


def published_curve(trial: Trial, placemap: Map) -> tuple[float, float]:
    """AUC and recall of a recognizer's smoothed matches."""
    recognizer = Recognizer(placemap, trial.config)
    for raw in trial.query.raws:
        recognizer.update_raw(raw)
    curve = judge([each.match for each in recognizer.finish()], trial.truth).curve
    return curve.auc, curve.recall_at_100_precision


@pytest.mark.parametrize("number", range(1, 11))
def test_combinations_differ_and_are_the_same_for_the_same_seed(number: int) -> None:
    drawn = combinations(10, number, seed=3)
    assert len(set(drawn)) == len(drawn) == min(comb(10, number), 60)
    assert all(len(set(one)) == number and {*one} <= {*range(10)} for one in drawn)
    assert drawn == combinations(10, number, seed=3)
    if len(drawn) == 60:
        assert drawn != combinations(10, number, seed=4)
