import tracemalloc

import numpy as np
import pytest
from metric_learn import LMNN
from metric_learn.lmnn import _sum_outer_products

from placefield.metric import lmnn
from placefield.metric.lmnn import fit_lmnn, loss, objective, target_neighbours

SIZES = (7, 6, 5, 3, 2, 1)  # points of each label; three targets cannot be had in the last three


def made_points(sizes=SIZES, dimensions=4, seed=0):
    rng = np.random.default_rng(seed)
    labels = rng.permutation(np.repeat(np.arange(len(sizes)) * 3 - 1, sizes))
    return rng.normal(size=(len(labels), dimensions)) + 0.2 * labels[:, None], labels


def made_route(seed=0):
    """A random walk cut into runs, with two thirds of the frames in one label, as encoding does."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(size=(240, 30)), axis=0)
    labels = np.where(np.arange(240) % 24 < 8, 1 + np.arange(240) // 24, 0)
    return (walk - walk.mean(axis=0)).astype(np.float32) / 10, labels


def made_projection(rows, columns, seed=1):
    return np.eye(rows, columns) + 0.3 * np.random.default_rng(seed).normal(size=(rows, columns))


def reference_targets(points, labels, neighbours):
    targets = []
    for i in range(len(points)):
        others = [j for j in range(len(points)) if j != i and labels[j] == labels[i]]
        others.sort(key=lambda j, i=i: ((points[i] - points[j]) ** 2).sum())
        targets.append((others + [-1] * neighbours)[:neighbours])
    return np.array(targets)


def reference_objective(projection, points, labels, targets, push):
    def distance(a, b):
        return ((projection @ (points[a] - points[b])) ** 2).sum()

    pull_term = push_term = 0.0
    for i in range(len(points)):
        for j in targets[i]:
            if j < 0:
                continue
            pull_term += distance(i, j)
            for other in range(len(points)):
                if labels[other] != labels[i]:
                    push_term += max(0, 1 + distance(i, j) - distance(i, other))
    return (1 - push) * pull_term + push * push_term


@pytest.fixture(params=[5, 512], ids=["many blocks", "one block"])
def block(request, monkeypatch):
    monkeypatch.setattr(lmnn, "_BLOCK", request.param)


@pytest.mark.usefixtures("block")
def test_targets_are_the_nearest_of_the_same_label_as_far_as_there_are_any():
    points, labels = made_points()
    targets = target_neighbours(points, labels, 3)
    np.testing.assert_array_equal(targets, reference_targets(points, labels, 3))
    assert sorted((targets >= 0).sum(axis=1)) == [0] + 2 * [1] + 3 * [2] + 18 * [3]


def test_only_eligible_points_become_targets():
    points, labels = made_points()
    eligible = np.arange(len(labels)) % 3 > 0
    targets = target_neighbours(points, labels, 2, eligible)
    assert eligible[targets[targets >= 0]].all()
    np.testing.assert_array_equal(
        targets[eligible] >= 0,
        reference_targets(points[eligible], labels[eligible], 2) >= 0,
    )


@pytest.mark.usefixtures("block")
@pytest.mark.parametrize("push", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("rows", [4, 2])
def test_objective_is_the_naive_sum_over_triplets(push, rows):
    points, labels = made_points()
    targets = target_neighbours(points, labels, 3)
    projection = made_projection(rows, 4)
    value, _ = objective(projection, points, labels, targets, push)
    expected = reference_objective(projection, points, labels, targets, push)
    assert value == pytest.approx(expected, rel=1e-10)


@pytest.mark.usefixtures("block")
def test_gradient_is_the_finite_difference_of_the_objective():
    points, labels = made_points()
    targets = target_neighbours(points, labels, 3)
    projection = made_projection(3, 4)
    _, gradient = objective(projection, points, labels, targets, 0.4)
    for at in np.ndindex(projection.shape):
        step = np.zeros_like(projection)
        step[at] = 1e-6
        above, _ = objective(projection + step, points, labels, targets, 0.4)
        below, _ = objective(projection - step, points, labels, targets, 0.4)
        assert gradient[at] == pytest.approx((above - below) / 2e-6, rel=1e-5, abs=1e-5)


@pytest.mark.usefixtures("block")
def test_loss_is_the_objective_of_the_points_that_have_targets():
    points, labels = made_points()
    targets = target_neighbours(points, labels, 3)
    targets[::3] = -1
    projection = made_projection(4, 4)
    expected = reference_objective(projection, points, labels, targets, 0.4)
    assert loss(projection, points, labels, targets, 0.4) == pytest.approx(expected, rel=1e-10)


def test_value_and_gradient_are_those_of_metric_learn():
    points, labels = made_route()
    points = points.astype(np.float64)
    targets = target_neighbours(points, labels, 3)
    projection = made_projection(30, 30)
    peer = LMNN()
    peer.labels_ = np.unique(labels)
    pull = _sum_outer_products(points, targets.ravel(), np.repeat(np.arange(len(points)), 3))
    gradient, value, _ = peer._loss_grad(points, projection, pull, 3, 0.7, targets, labels)
    ours = objective(projection, points, labels, targets, push=0.3)
    assert ours[0] == pytest.approx(value, rel=1e-9)
    np.testing.assert_allclose(ours[1], gradient, rtol=1e-6, atol=1e-9 * np.abs(gradient).max())


def test_float32_keeps_six_digits_of_the_objective():
    points, labels = made_route()
    targets = target_neighbours(points, labels, 3)
    projection = made_projection(30, 30)
    value, gradient = objective(projection.astype(np.float32), points, labels, targets, 0.5)
    exact, _ = objective(projection, points.astype(np.float64), labels, targets, 0.5)
    assert gradient.dtype == np.float32
    assert value == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("learn_rate", [1e-7, 1e-4, 1e-3])
def test_as_many_steps_reach_an_objective_no_higher_than_metric_learns(learn_rate):
    points, labels = made_route()
    steps = 25
    peer = LMNN(init="identity", learn_rate=learn_rate, min_iter=steps + 2, max_iter=steps + 2)
    peer.fit(points, labels)
    fit = fit_lmnn(points, labels, neighbours=3, push=0.5, steps=steps)
    targets = target_neighbours(points, labels, 3)
    reached, _ = objective(peer.components_, points.astype(float), labels, targets, 0.5)
    assert len(fit.objective) == steps + 1
    assert fit.objective[-1] <= reached


def test_every_step_lowers_the_objective_and_the_last_projection_has_the_last_value():
    points, labels = made_points()
    points = points.astype(np.float32)
    fit = fit_lmnn(points, labels, neighbours=3, push=0.5, steps=60)
    assert (np.diff(fit.objective) < 0).all()
    targets = target_neighbours(points, labels, 3)
    last = reference_objective(fit.projection.astype(float), points, labels, targets, 0.5)
    assert fit.objective[-1] == pytest.approx(last, rel=1e-5)


def test_same_input_gives_the_same_bits():
    points, labels = made_route()
    fits = [fit_lmnn(points, labels, neighbours=3, push=0.5, steps=8) for _ in range(2)]
    assert fits[0].projection.tobytes() == fits[1].projection.tobytes()
    assert fits[0].objective.tobytes() == fits[1].objective.tobytes()


def test_on_step_receives_every_step_and_stops_the_descent():
    points, labels = made_route()
    steps_reported = []

    def stop_at_three(step, projection):
        steps_reported.append((step, projection))
        return step == 3

    fit = fit_lmnn(points, labels, neighbours=3, push=0.5, steps=9, on_step=stop_at_three)
    assert [step for step, _ in steps_reported] == [1, 2, 3]
    assert fit.projection is steps_reported[-1][1]
    assert len(fit.objective) == 4


def test_descent_goes_on_from_where_it_is_started():
    points, labels = made_route()
    first = fit_lmnn(points, labels, neighbours=3, push=0.5, steps=4)
    second = fit_lmnn(points, labels, neighbours=3, push=0.5, steps=4, start=first.projection)
    assert second.objective[0] == first.objective[-1]


@pytest.mark.parametrize("labels", [np.arange(6), np.zeros(6, dtype=int)], ids=["alone", "one"])
def test_labels_that_leave_nothing_to_push_end_in_a_valid_fit(labels):
    points = np.random.default_rng(0).normal(size=(6, 3)).astype(np.float32)
    fit = fit_lmnn(points, labels, neighbours=2, push=0.5, steps=5)
    assert np.isfinite(fit.projection).all()
    assert (np.diff(fit.objective) < 0).all()


@pytest.mark.usefixtures("block")
def test_the_same_points_at_one_place_are_each_others_targets_and_impostors():
    points = np.repeat(np.array([[0.0, 0.0], [3.0, 0.0]]), 3, axis=0)
    labels = np.array([0, 0, 1, 0, 1, 1])
    targets = target_neighbours(points, labels, 2)
    assert targets[0].tolist() == [1, 3]
    value, _ = objective(np.eye(2), points, labels, targets, 0.4)
    expected = reference_objective(np.eye(2), points, labels, targets, 0.4)
    assert value == pytest.approx(expected)


def test_memory_does_not_grow_with_the_square_of_the_points():
    points = np.random.default_rng(0).normal(size=(4000, 20)).astype(np.float32)
    labels = np.arange(4000) // 10
    targets = target_neighbours(points, labels, 3)
    objective(np.eye(20, dtype=np.float32), points, labels, targets, 0.5)
    tracemalloc.start()
    objective(np.eye(20, dtype=np.float32), points, labels, targets, 0.5)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4000 * 4000 * 4 / 20
