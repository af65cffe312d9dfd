from dataclasses import replace

import numpy as np
import pytest

from placefield.errors import MapError
from placefield.maps.map import MapChannel
from placefield.recognizer import Recognizer
from placefield_tools.evaluating import judge
from placefield_tools.study.scales import compare_scales
from placefield_tools.study.trial import Trial


def auc(trial: Trial, *channels: MapChannel) -> float:
    placemap = replace(trial.placemap, channels=channels)
    recognizer = Recognizer(placemap, trial.matching("lowest-score"))
    return judge([recognizer.push_raw(raw) for raw in trial.query.raws], trial.truth).curve.auc


def test_many_are_the_whole_map_and_one_is_the_mean_of_channels_alone(trial: Trial) -> None:
    found = {(r.method, r.scales): r.auc for r in compare_scales(trial)}

    fixed = trial.multiscale.channels
    alone = [auc(trial, replace(c, scales=c.scales[-1:])) for c in fixed]  # its own, not 6
    assert found == {
        ("MS", "one"): pytest.approx(np.mean(alone)),
        ("MS", "many"): auc(trial, *fixed),
        ("AMS", "one"): pytest.approx(
            np.mean(
                [
                    auc(trial, replace(c, scales=c.scales[[len(c.scales) // 2]]))
                    for c in trial.published.channels
                ]
            )
        ),
        ("AMS", "many"): auc(trial, *trial.published.channels),
    }


def test_where_ms_fails_adaptive_scales_are_alone(
    trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_short(_: Trial) -> None:
        raise MapError("too short")

    monkeypatch.setattr(Trial, "multiscale", property(too_short))
    assert [(r.method, r.scales) for r in compare_scales(trial)] == [
        ("AMS", "one"),
        ("AMS", "many"),
    ]
