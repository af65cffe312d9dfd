from dataclasses import replace

import numpy as np
import pytest

from placefield.errors import MapError
from placefield.maps.map import MapChannel
from placefield.recognizer import Recognizer
from placefield_tools.evaluate.judging import judge
from placefield_tools.study.neighbours import learned_by
from placefield_tools.study.paper import run_paper as running
from placefield_tools.study.paper.cost import comparisons, multiplications
from placefield_tools.study.paper.paper_results import Cost, PaperStudy
from placefield_tools.study.paper.run_paper import one_scale
from placefield_tools.study.trial import Trial


def auc(trial: Trial, channels: tuple[MapChannel, ...]) -> float:
    """Of a recognizer's smoothed matches."""
    recognizer = Recognizer(replace(trial.placemap, channels=channels), trial.config)
    for raw in trial.query.raws:
        recognizer.update_raw(raw)
    return judge([each.match for each in recognizer.finish()], trial.truth).curve.auc


def test_both_features_are_studied_each_with_its_own_map(paper_study: PaperStudy) -> None:
    assert [result.feature for result in paper_study.features] == ["gist", "grayscale"]
    for result in paper_study.features:
        assert result.placemap.model.kind == result.feature
        assert result.placemap.model.plain
        assert [(x.method, x.scales) for x in result.lines] == [
            ("MS", "one"),
            ("MS", "many"),
            ("AMS", "one"),
            ("AMS", "many"),
        ]
        assert len(result.counts) == 10
    assert [other.name for other in paper_study.others] == ["SeqSLAM", "FAB-MAP"]


def test_many_scales_are_the_maps_and_one_is_the_same_for_all_channels(
    paper_trial: Trial, paper_study: PaperStudy
) -> None:
    result = paper_study.features[0]
    adaptive, fixed = paper_trial.placemap.channels, paper_trial.multiscale.channels
    every = np.sort([scale for channel in adaptive for scale in channel.scales])
    length = int(every[len(every) // 2])
    assert result.one_scale == one_scale(adaptive) == length
    for method, channels in (("MS", fixed), ("AMS", adaptive)):
        alone = tuple(
            replace(one, scales=np.array([length], np.int32), smallest=length) for one in channels
        )
        for scales, used in (("one", alone), ("many", tuple(channels))):
            line = result.line(method, scales)
            assert line is not None
            assert line.judged.curve.auc == auc(paper_trial, used)


def test_where_ms_or_ten_channels_cannot_be_the_rest_is_there(
    paper_trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_short(*_: object) -> None:
        raise MapError("too short")

    monkeypatch.setattr(Trial, "multiscale", property(too_short))
    monkeypatch.setattr(running, "count_channels", too_short)
    result = running.run_feature(paper_trial)
    assert result.fixed is None
    assert {line.method for line in result.lines} == {"AMS"}
    assert result.counts == ()


def test_invaders_are_nearer_than_the_farthest_target_neighbour(paper_trial: Trial) -> None:
    learned = learned_by(paper_trial)
    assert learned is not None
    channel = paper_trial.placemap.channels[0]
    places = paper_trial.placemap.model.of_reference(paper_trial.traverse.raw).astype(float)
    for points, mean in (
        (places, learned.invaders_before),
        (places @ channel.metric.projection.T.astype(float), learned.invaders_after),
    ):
        counts = [literal_invaders(i, places, points, channel.labels) for i in range(len(points))]
        assert mean == np.mean(counts)
        if points is places:
            assert counts[learned.place] == max(counts)
    assert learned.before.targets.sum() == learned.after.targets.sum() > 0


def test_where_no_metric_was_learned_there_is_nothing_to_show(trial: Trial) -> None:
    assert not trial.placemap.channels[0].metric.learned
    assert learned_by(trial) is None


def literal_invaders(
    i: int, chosen_among: np.ndarray, points: np.ndarray, labels: np.ndarray
) -> int:
    """Count frames of other labels nearer to i than the farthest of its 3 target neighbours."""
    companions = [j for j in range(len(points)) if j != i and labels[j] == labels[i]]
    companions.sort(key=lambda j: float(np.linalg.norm(chosen_among[i] - chosen_among[j])))
    if not companions:
        return 0
    radius = max(float(np.linalg.norm(points[i] - points[j])) for j in companions[:3])
    others = [j for j in range(len(points)) if labels[j] != labels[i]]
    return sum(float(np.linalg.norm(points[i] - points[j])) < radius for j in others)


def test_comparisons_are_those_of_the_papers_example() -> None:
    cost = Cost(places=1261, dimensions=500, channels=4, longest=52, seconds=1, kept_bytes=1)
    assert comparisons(cost) == pytest.approx(131e6, rel=0.01)
    assert comparisons(cost) / 2**20 == pytest.approx(125, rel=0.01)
    assert 1e9 / comparisons(cost, one_scale=True) == pytest.approx(396, rel=0.01)
    assert comparisons(cost, one_scale=True) / 2**20 == pytest.approx(2.4, rel=0.01)
    assert multiplications(cost) == 4 * 500 * 500 + 4 * 500 * 1261


def test_what_a_frame_costs_is_measured(paper_study: PaperStudy) -> None:
    for result in paper_study.features:
        cost = result.cost
        assert cost.places == 60
        assert cost.longest == max(int(c.scales.max()) for c in result.placemap.channels)
        assert 0 < cost.seconds < 1
        assert cost.kept_bytes > sum(m.places.nbytes for m in result.placemap.metrics)
