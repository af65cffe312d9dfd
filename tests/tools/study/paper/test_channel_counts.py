from dataclasses import replace
from math import comb

import pytest
from placefield_tools.study.channel_counts import CHANNELS, combinations, count_channels

from placefield.recognizer import Recognizer
from placefield_tools.evaluating import RULES, judge
from placefield_tools.study.results import CountResult
from placefield_tools.study.trial import Trial


@pytest.fixture(scope="module")
def counts(trial: Trial) -> tuple[CountResult, ...]:
    return count_channels(trial)


def test_every_number_of_channels_is_combined_by_every_rule(
    counts: tuple[CountResult, ...],
) -> None:
    assert [(c.rule, c.channels) for c in counts] == [
        (rule, number) for rule in RULES for number in range(1, CHANNELS + 1)
    ]
    for count in counts:
        tried = min(comb(CHANNELS, count.channels), 20)
        assert count.auc.shape == count.recall.shape == (tried,)


def test_all_channels_together_and_one_alone_are_maps_of_these_channels(
    trial: Trial, counts: tuple[CountResult, ...]
) -> None:
    scales = trial.config.scales.model_copy(update={"channels": CHANNELS})
    metric = trial.config.metric.model_copy(update={"kind": "identity"})
    config = trial.config.model_copy(update={"scales": scales, "metric": metric})
    placemap = trial.build(config)

    for count in counts:
        chosen = {1: placemap.channels[:1], CHANNELS: placemap.channels}.get(count.channels)
        if chosen is None:
            continue
        fewer = replace(placemap, channels=chosen)
        recognizer = Recognizer(fewer, trial.matching(count.rule))
        curve = judge([recognizer.push_raw(raw) for raw in trial.query.raws], trial.truth).curve
        assert (count.auc[0], count.recall[0]) == (curve.auc, curve.recall_at_100_precision)


@pytest.mark.parametrize("number", range(1, 11))
def test_combinations_differ_and_are_the_same_for_the_same_seed(number: int) -> None:
    drawn = combinations(10, number, seed=3)
    assert len(set(drawn)) == len(drawn) == min(comb(10, number), 20)
    assert all(len(set(one)) == number and {*one} <= {*range(10)} for one in drawn)
    assert drawn == combinations(10, number, seed=3)
    if len(drawn) == 20:
        assert drawn != combinations(10, number, seed=4)
