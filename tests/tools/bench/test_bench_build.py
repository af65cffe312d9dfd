"""What the benchmark of building compares, on routes small enough for a test."""

import numpy as np
import pytest

from placefield_tools.bench import build
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
    monkeypatch.setattr(build, "_PLAIN_STEPS", 3)
    figures = as_object(build._lmnn_figures())
    assert figures["lmnn_objective_ratio"] <= 1
    assert figures["lmnn_speedup"] == figures["metric_learn_s"] / figures["lmnn_s"]


def test_the_command_is_timed_and_its_memory_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "_FRAMES", 40)
    monkeypatch.setattr(build, "_CHANNELS", 2)
    figures = as_object(build._command_figures())
    assert all(np.isfinite(value) and value > 0 for value in figures.values())
    assert figures["build_peak_mb"] > 20
