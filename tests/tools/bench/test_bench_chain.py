"""Figures of what was measured on chains; the chains themselves are measured by nobody here."""

import numpy as np
import pytest

from placefield_tools.bench.chain import latency_figures, rate_figures
from placefield_tools.bench.figure import as_object
from placefield_tools.bench.load import Answers
from placefield_tools.bench.many_cameras import Load, load_figures, share_figures


def answers(sent: int, *milliseconds: float) -> Answers:
    return Answers(sent, np.array(milliseconds) / 1e3)


def test_rates_are_medians_over_the_replays() -> None:
    found = as_object(rate_figures([(150, 700), (160, 900), (90, 800)]))
    assert found["chain_frames_per_s"] == 150
    assert found["chain_idle_frames_per_s"] == 800


def test_latencies_are_compared_within_a_round() -> None:
    quiet = answers(3, 2, 4, 6), answers(3, 1, 2, 3)
    busy = answers(4, 80, 80, 80), answers(3, 20, 20, 20)
    found = as_object(latency_figures([quiet, busy]))
    assert found["chain_latency_ms"] == pytest.approx((4 + 80) / 2)
    assert found["chain_latency_ratio"] == pytest.approx((2 + 4) / 2)
    assert found["chain_lost_frames"] == 1


def test_computing_time_is_reported_by_answered_frame() -> None:
    together, separate = Load(answers(4, 5, 6, 7, 8), 0.02), Load(answers(4, 9, 9), 0.03)
    found = as_object(load_figures([together], [(together, separate)]))
    assert found["cameras_lost_frames"] == 0
    assert found["cameras_separate_lost_frames"] == 2
    assert found["cameras_cpu_ms"] == pytest.approx(5)
    assert found["cameras_cpu_ratio"] == pytest.approx(3)


def test_layouts_of_cameras_are_compared_within_a_turn() -> None:
    quiet = Load(answers(2, 5, 5), 0.02), Load(answers(2, 5, 5), 0.04)
    busy = Load(answers(2, 9), 0.1), Load(answers(2, 9, 9), 0.8)
    alone = [Load(answers(2, 5, 5), 0.02), Load(answers(2, 9), 0.1)]
    found = as_object(load_figures(alone, [quiet, busy]))
    assert found["cameras_cpu_ratio"] == pytest.approx((2 + 4) / 2)
    assert found["cameras_cpu_ms"] == pytest.approx(120 / 3)
    assert found["cameras_lost_frames"] == 1


def test_the_shares_of_too_many_cameras_are_compared() -> None:
    found = as_object(share_figures([answers(4, 5, 5), answers(4, 5), answers(4, 5, 5, 5)]))
    assert found["too_many_answered"] == pytest.approx(0.5)
    assert found["too_many_fairness"] == pytest.approx(1 / 3)
    nothing = as_object(share_figures([answers(4), answers(4)]))
    assert nothing["too_many_fairness"] == 0


def test_no_two_figures_of_the_chain_have_the_same_key() -> None:
    some = answers(1, 5.0)
    load = Load(some, 1.0)
    stream = [*rate_figures([(1, 1)]), *latency_figures([(some, some)])]
    assert len(as_object([*stream, *load_figures([load], [(load, load)])])) == 18
