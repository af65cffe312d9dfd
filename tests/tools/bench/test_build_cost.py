"""What the benchmark of building compares, on routes small enough for a test."""

import numpy as np
import pytest

from placefield_tools.bench import build_cost as build
from placefield_tools.bench.described_build import described_build
from placefield_tools.bench.figure import as_object


def test_the_labelled_route_is_that_of_the_bar() -> None:
    points, labels = build._labelled_route()
    assert points.shape == (1200, 500)
    assert len(np.unique(labels)) == 49
    assert np.mean(labels == 0) == pytest.approx(2 / 3, abs=0.02)


def test_ours_is_timed_to_an_objective_no_higher_than_metric_learns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points, labels = build._labelled_route()
    monkeypatch.setattr(build, "_labelled_route", lambda: (points[:150, :20], labels[:150]))
    monkeypatch.setattr(build, "_METRIC_LEARN_STEPS", 3)
    monkeypatch.setattr(build, "_LIMIT_S", 0.0)
    figures = as_object(build._lmnn_figures())
    for kind in ("", "_long_steps"):
        assert figures[f"lmnn{kind}_objective_ratio"] <= 1
        times = figures[f"metric_learn{kind}_s"], figures[f"lmnn{kind}_s"]
        assert figures[f"lmnn{kind}_speedup"] == times[0] / times[1]  # of one round
    assert figures["metric_learn_long_steps_gain"] < figures["metric_learn_gain"] < 1


@pytest.mark.parametrize(("traverses", "channels"), [(1, 1), (2, 2)])
def test_memory_is_at_least_that_of_the_features(
    monkeypatch: pytest.MonkeyPatch, traverses: int, channels: int
) -> None:
    monkeypatch.setattr(build, "_LARGE", 300)
    assert build._memory_ratio(traverses, channels) > 0.5


def test_the_command_is_timed_and_its_memory_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "_FRAMES", 40)
    monkeypatch.setattr(build, "_CHANNELS", 2)
    monkeypatch.setattr(build, "_LIMIT_S", 0.0)
    figures = as_object(build._command_figures())
    assert all(np.isfinite(value) and value > 0 for value in figures.values())
    assert figures["build_peak_mb"] > 20


def test_a_build_of_described_places_has_targets_up_to_a_million() -> None:
    figures = described_build(400)
    assert [figure.at_most for figure in figures] == [1200, None, 6000]
    assert all(value > 0 for value in as_object(figures).values())
