import numpy as np
import pytest
from metric_learn import LFDA, NCA, RCA

from placefield.config import MetricConfig
from placefield.metric.learners import NothingLearnedError, fit_reference_learner

KINDS = ["rca", "lfda", "nca"]


def made_points(frames=96, dimensions=30):
    """Points in segments of 8, every sixth of which is inactive."""
    rng = np.random.default_rng(0)
    segments = np.arange(frames) // 8
    points = rng.normal(size=(frames // 8, dimensions))[segments]
    points += 0.3 * rng.normal(size=points.shape)
    return points.astype(np.float32), np.where(segments % 6 == 5, 0, segments + 1)


@pytest.mark.parametrize(
    ("kind", "learner"),
    [
        ("rca", RCA()),
        ("lfda", LFDA(k=3)),
        ("nca", NCA(init="identity", max_iter=30, random_state=0)),
    ],
)
def test_it_is_metric_learns_on_the_active_frames_first_dimensions(kind, learner):
    points, labels = made_points()
    active = labels > 0
    dimensions = active.sum() // 4
    learner.fit(points[active, :dimensions].astype(np.float64), labels[active])
    projection = fit_reference_learner(points, labels, MetricConfig(kind=kind), 0)
    expected = np.zeros((30, 30))
    expected[:dimensions, :dimensions] = learner.components_
    np.testing.assert_allclose(projection, expected, rtol=1e-4, atol=1e-6)
    assert projection.dtype == np.float32


def test_any_seed_is_accepted():
    points, labels = made_points()
    config = MetricConfig(kind="nca")
    np.testing.assert_array_equal(
        fit_reference_learner(points, labels, config, 2**32 + 7),
        fit_reference_learner(points, labels, config, 7),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_segment_of_one_frame_changes_nothing(kind):
    points, labels = made_points()
    config = MetricConfig(kind=kind)
    alone = np.where(np.arange(len(labels)) == 0, 99, labels)
    without = np.where(np.arange(len(labels)) == 0, 0, labels)
    np.testing.assert_array_equal(
        fit_reference_learner(points, alone, config, 0),
        fit_reference_learner(points, without, config, 0),
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("labels", "reason"),
    [
        (np.zeros(96, int), "fewer than two segments"),
        (np.ones(96, int), "fewer than two segments"),
        (np.arange(1, 97), "fewer than two segments"),
        (np.where(np.arange(96) < 4, 1 + np.arange(96) // 2, 0), "too few frames"),
    ],
)
def test_labels_that_teach_nothing_are_refused(kind, labels, reason):
    points, _ = made_points()
    with pytest.raises(NothingLearnedError, match=reason):
        fit_reference_learner(points, labels, MetricConfig(kind=kind), 0)


@pytest.mark.parametrize("kind", ["rca", "lfda"])
@pytest.mark.parametrize("where", [np.s_[:], np.s_[:, 3:]])
def test_singular_covariances_are_refused(kind, where):
    points, labels = made_points()
    points[where] = 1
    with pytest.raises(NothingLearnedError, match="singular"):
        fit_reference_learner(points, labels, MetricConfig(kind=kind), 0)


def test_more_neighbours_than_dimensions_are_as_many_as_there_can_be():
    points, labels = made_points()
    config = MetricConfig(kind="lfda", neighbours=500)
    assert fit_reference_learner(points, labels, config, 0).any()
