"""The weight of the push term against a count of nearest neighbours, frame by frame."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import MetricConfig
from placefield.metric import cross_validation
from placefield.metric.cross_validation import LAMBDAS, choose_push, push_of
from placefield.metric.learn import learn_projection

Array = NDArray[np.float32]
Labels = NDArray[np.int64]

LMNN = MetricConfig(kind="lmnn", push="cross-validation", kept=1, gate=False, steps=12)


def made_route(seed: int, traverses: int = 1, apart: float = 1.0) -> tuple[Array, Labels, Labels]:
    """Descriptors of segments of 6, their labels, and their places; in no order."""
    rng = np.random.default_rng(seed)
    places = np.tile(np.arange(54), traverses)
    labels = places // 6
    views = apart * rng.normal(size=(9, 8))[labels]
    views += (0.3 * np.cumsum(rng.normal(size=(54, 8)), axis=0))[places]
    views += rng.normal(scale=0.7 / math.sqrt(traverses), size=views.shape)
    order = rng.permutation(len(places))
    centred = (views - views.mean(axis=0)).astype(np.float32)
    return centred[order], labels[order], places[order]


def reference_errors(
    descriptors: Array, labels: Labels, places: Labels, weight: float, seed: int
) -> int:
    """Count the frames whose nearest one of another part is of another label."""
    part_of_block = np.random.default_rng(seed).permutation(math.ceil((max(places) + 1) / 3))
    parts = [int(part_of_block[place // 3]) % 5 for place in places]
    learner = LMNN.model_copy(update={"push": weight / (1 + weight)})
    wrong = 0
    for part in range(5):
        trained = [i for i, own in enumerate(parts) if own != part]
        asked = [i for i, own in enumerate(parts) if own == part]
        order = trained + asked
        metric = learn_projection(
            descriptors[order], labels[order], len(trained), None, learner, seed=0
        )
        v = metric.projection.astype(np.float64)
        for i in asked:
            nearest = min(trained, key=lambda j: math.dist(v @ descriptors[i], v @ descriptors[j]))
            wrong += labels[nearest] != labels[i]
    return wrong


@pytest.mark.parametrize(("traverses", "seed"), [(1, 1), (1, 3), (1, 6), (2, 2), (2, 6), (2, 7)])
def test_the_weight_is_that_of_the_fewest_errors(
    traverses: int, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross_validation, "_BLOCK", 4)
    route = made_route(seed, traverses)
    errors = [reference_errors(*route, weight, seed) for weight in LAMBDAS]
    assert len(set(errors)) > 1
    fewest = LAMBDAS[errors.index(min(errors))]
    assert choose_push(*route, LMNN, seed) == pytest.approx(fewest / (1 + fewest))


def test_of_several_the_smallest_is_chosen() -> None:
    route = made_route(0, apart=20)
    assert {reference_errors(*route, weight, 0) for weight in LAMBDAS} == {0}
    assert choose_push(*route, LMNN, 0) == push_of(min(LAMBDAS))


def test_all_frames_of_a_place_are_held_back_together() -> None:
    places = np.tile(np.arange(54), 2)
    parts = cross_validation._parts(places, seed=0)
    np.testing.assert_array_equal(parts[:54], parts[54:])
    assert np.bincount(parts[:54]).tolist() == [12, 12, 12, 9, 9]


@pytest.mark.parametrize(("weight", "share"), [(0, 0), (0.25, 0.2), (1, 0.5)])
def test_the_push_is_the_share_of_the_weight(weight: float, share: float) -> None:
    assert push_of(weight) == pytest.approx(share)
