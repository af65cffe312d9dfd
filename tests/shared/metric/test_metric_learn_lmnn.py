"""metric-learn's LMNN in place of placefield's: the same metric, where both can learn it."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.loading import load_config
from placefield.maps.build import build_map
from placefield.maps.learning import held_back_places
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse
from placefield.matching.candidate import UNANSWERED
from placefield.metric.lmnn import fit_lmnn
from placefield.metric.metric_learn_lmnn import fit_lmnn_by_metric_learn
from placefield.recognizer import Recognizer
from placefield.scales.channels import Channel
from placefield.scales.encoding import encode

Array = NDArray[np.float32]
Labels = NDArray[np.int64]

CUTS = ((12, 10, 11, 14, 13), (15, 9, 17, 10, 9))
"""Lengths of the segments of two channels, frames."""


def made_views(sizes: Sequence[int], *, noise_seed: int = 0, dimensions: int = 10) -> Array:
    """Looks that change with the segment, gradually inside it, and by noise of many dimensions."""
    rng = np.random.default_rng(3)
    views = np.repeat(rng.normal(size=(len(sizes), dimensions)), sizes, axis=0)
    views += 0.2 * np.cumsum(rng.normal(size=views.shape), axis=0)
    own = np.random.default_rng(noise_seed)
    return (views + 0.7 * own.normal(size=views.shape)).astype(np.float32)


def map_by(solver: str, raws: Array) -> Map:
    flags = {
        "preset": "paper",
        "features": {"dimensions": 8},
        "metric": {"solver": solver, "push": 0.4},
    }

    def cut(*_: object) -> tuple[Channel, ...]:
        clusters = [np.repeat(np.arange(len(sizes)), sizes) for sizes in CUTS]
        return tuple(Channel(1.1, own, encode(own, 4)) for own in clusters)

    count = len(raws)
    traverse = Traverse(
        "made up",
        raws,
        np.arange(count, dtype=np.int64),
        np.empty((0, 3)),
        np.empty(0),
        (b"",) * count,
    )
    return build_map([traverse], load_config(None, flags), cut=cut)


def smoothed(placemap: Map, raws: Array) -> list[tuple[int, float]]:
    recognizer = Recognizer(placemap, load_config(None, {"preset": "paper"}))
    for raw in raws:
        recognizer.update_raw(raw)
    matches = recognizer.smoothed() + recognizer.finish()
    return [(each.match.place, each.match.score) for each in matches]


def test_it_learns_the_same_metrics_and_so_gives_the_same_matches() -> None:
    day, night = made_views(CUTS[0]), made_views(CUTS[0], noise_seed=1)
    ours, theirs = (map_by(solver, day) for solver in ("placefield", "metric-learn"))
    trained = ~held_back_places(len(day), seed=0)
    for channel, other in zip(ours.channels, theirs.channels, strict=True):
        assert np.unique(channel.labels[trained], return_counts=True)[1].min() > 3
        assert len(channel.curve) > 5
        assert not np.allclose(channel.metric.projection, np.eye(8), atol=0.02)
        np.testing.assert_allclose(other.metric.projection, channel.metric.projection, atol=1e-4)
        np.testing.assert_allclose(other.curve, channel.curve, rtol=1e-3)
    of_ours, of_theirs = smoothed(ours, night), smoothed(theirs, night)
    assert [place for place, _ in of_theirs] == [place for place, _ in of_ours]
    assert sum(place != UNANSWERED for place, _ in of_ours) > 40
    for (_, score), (_, other_score) in zip(of_ours, of_theirs, strict=True):
        assert other_score == pytest.approx(score, rel=0.02)  # rounding to codes


Fit = tuple[Array, NDArray[np.float64], int]
"""The projection, the objective, and how many steps were reported."""


def fits(points: Array, labels: Labels, *, by_metric_learn: bool, steps: int = 8) -> Fit:
    reported: list[int] = []

    def on_step(number: int, projection: Array) -> bool:
        assert projection.dtype == np.float32
        reported.append(number)
        return False

    fit = (fit_lmnn_by_metric_learn if by_metric_learn else fit_lmnn)(
        points,
        labels,
        neighbours=3,
        push=0.4,
        steps=steps,
        start=np.eye(points.shape[1], dtype=np.float32),
        on_step=on_step,
    )
    assert reported == list(range(1, len(fit.objective)))
    return fit.projection, fit.objective, len(reported)


def points_of(sizes: Sequence[int]) -> tuple[Array, Labels]:
    views = made_views(sizes)
    return views - views.mean(axis=0), np.repeat(np.arange(len(sizes)), sizes)


def test_step_for_step_the_objective_is_the_same_where_every_label_has_more_than_k_frames() -> None:
    points, labels = points_of((4, 9, 12, 4, 8))
    projection, objective, steps = fits(points, labels, by_metric_learn=False)
    other, other_objective, other_steps = fits(points, labels, by_metric_learn=True)
    assert steps == other_steps == 8
    np.testing.assert_allclose(other, projection, atol=1e-5)
    np.testing.assert_allclose(other_objective, objective, rtol=1e-5)


def test_frames_of_labels_with_no_more_than_k_are_left_out() -> None:
    points, labels = points_of((3, 9, 12, 2, 8, 1))
    counts = np.bincount(labels)
    kept = counts[labels] > 3
    assert np.count_nonzero(~kept) == 6
    without, objective, _ = fits(points[kept], labels[kept], by_metric_learn=False)
    found, its_objective, _ = fits(points, labels, by_metric_learn=True)
    np.testing.assert_allclose(found, without, atol=1e-5)
    np.testing.assert_allclose(its_objective, objective, rtol=1e-5)
    with_all, _, _ = fits(points, labels, by_metric_learn=False)
    assert not np.allclose(found, with_all, atol=1e-2)


def test_where_no_frame_invades_it_pulls_on() -> None:
    points, labels = points_of((6, 6))
    points[labels == 1] += 8
    points -= points.mean(axis=0)
    projection, objective, steps = fits(points, labels, by_metric_learn=False)
    other, other_objective, other_steps = fits(points, labels, by_metric_learn=True)
    assert steps == other_steps == 8
    np.testing.assert_allclose(other, projection, atol=1e-4)
    np.testing.assert_allclose(other_objective, objective, rtol=1e-4)


@pytest.mark.parametrize("sizes", [(6, 3, 2), (3, 3, 2)])
def test_of_less_than_two_labels_that_are_left_nothing_is_learned(sizes: Sequence[int]) -> None:
    points, labels = points_of(sizes)
    projection, objective, steps = fits(points, labels, by_metric_learn=True)
    assert steps == 0
    assert len(objective) == 1
    np.testing.assert_array_equal(projection, np.eye(points.shape[1], dtype=np.float32))
