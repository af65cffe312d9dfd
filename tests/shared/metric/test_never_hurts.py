"""Learned metrics on real routes: what passes the gate costs no recognition."""

from typing import get_args

import numpy as np
import pytest

from placefield.config import Config, MetricKind
from placefield.evaluation.curves import precision_recall
from placefield.evaluation.truth import Truth
from placefield.features.extract import feature_of
from placefield.maps.build import build_map
from placefield.maps.traverse import Traverse
from placefield.recognizer import Recognizer

NIGHT, LEFT, RIGHT = "night_right", "day_left", "day_right"
LEARNED = [kind for kind in get_args(MetricKind) if kind != "identity"]


@pytest.fixture(scope="module")
def raw_features(data_dir):
    """Of the three traverses of Gardens Point, by feature and traverse."""
    raws = {}
    for kind in ("gist", "grayscale"):
        feature = feature_of(kind)
        for traverse in (NIGHT, LEFT, RIGHT):
            files = sorted((data_dir / "gardens_point" / traverse).iterdir())
            raws[kind, traverse] = np.stack([feature.describe(f.read_bytes()) for f in files])
    return raws


def build(raw_features, feature, references, metric):
    traverses = [
        Traverse(name, raw, np.arange(len(raw)), np.empty((0, 3)), np.empty(0), (b"",) * len(raw))
        for name, raw in ((name, raw_features[feature, name]) for name in references)
    ]
    config = {"features": {"kind": feature}, "metric": {"kind": metric}, "scales": {"channels": 2}}
    return build_map(traverses, Config.model_validate(config))


def auc(placemap, query):
    recognizer = Recognizer(placemap)
    matches = [recognizer.update_raw(raw) for raw in query]
    places = np.array([match.place for match in matches])
    scores = np.array([match.score for match in matches])
    truth = Truth.within(len(query), placemap.places.count, 3)
    return precision_recall(truth.correct(places), places >= 0, truth.on_route, scores).auc


@pytest.mark.parametrize(
    ("feature", "references", "query"),
    [
        ("gist", (LEFT, RIGHT), NIGHT),
        ("gist", (RIGHT, LEFT), NIGHT),
        ("gist", (LEFT, NIGHT), RIGHT),
        ("gist", (NIGHT, LEFT), RIGHT),
        ("gist", (NIGHT, RIGHT), LEFT),
        ("gist", (RIGHT, NIGHT), LEFT),
        ("grayscale", (LEFT, NIGHT), RIGHT),
        ("grayscale", (RIGHT, NIGHT), LEFT),
    ],
)
def test_no_metric_of_two_traverses_recognises_a_third_worse(
    raw_features, feature, references, query
):
    frames = raw_features[feature, query]
    identity = auc(build(raw_features, feature, references, "identity"), frames)
    for kind in LEARNED:
        built = build(raw_features, feature, references, kind)
        if any(channel.metric.learned for channel in built.channels):
            assert auc(built, frames) >= identity - 0.01, kind


def test_of_two_traverses_something_is_learned(raw_features):
    built = build(raw_features, "gist", (LEFT, NIGHT), "lmnn")
    assert any(channel.metric.learned for channel in built.channels)
