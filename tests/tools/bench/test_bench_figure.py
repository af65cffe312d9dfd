"""Figures as a table and as JSON."""

import pytest

from placefield_tools.bench.figure import Figure, as_object, print_figures
from placefield_tools.bench.ratio import Ratio


@pytest.mark.parametrize(
    ("figure", "bar", "is_met"),
    [
        (Figure("speed", 9.0, "", at_least=8), "≥ 8", True),
        (Figure("speed", 7.9, "", at_least=8), "≥ 8", False),
        (Figure("lost", 0, "", at_most=0), "≤ 0", True),
        (Figure("lost", 1, "", at_most=0), "≤ 0", False),
        (Figure("lost", float("nan"), "", at_most=0), "≤ 0", False),
        (Figure("time", 3.0, ""), "", True),
    ],
)
def test_a_figure_is_held_to_its_bar(figure: Figure, bar: str, is_met: bool) -> None:
    assert figure.bar == bar
    assert figure.is_met == is_met


def test_the_object_has_a_key_per_figure() -> None:
    figures = [Figure("speedup", 9.5, "how much faster", at_least=8), Figure("lost", 0, "frames")]
    assert as_object(figures) == {"speedup": 9.5, "lost": 0}


def test_the_object_has_the_ends_of_an_interval_if_there_is_one() -> None:
    figures = [
        Figure("speedup", Ratio(9.5, 9.3, 9.8), ""),
        Figure("slow_speedup", Ratio(3, float("nan"), float("nan")), "of few rounds"),
    ]
    assert as_object(figures) == {
        "speedup": 9.5,
        "speedup_low": 9.3,
        "speedup_high": 9.8,
        "slow_speedup": 3,
    }


@pytest.mark.parametrize(
    ("measured", "interval"),
    [
        (9.5, ""),
        (Ratio(9.5, 9.3, 9.8), "9.3 to 9.8"),
        (Ratio(9.5, 8.25, 9.8), "8.25 to 9.8, wide"),
        (Ratio(9.5, float("nan"), float("nan")), "too few rounds"),
    ],
)
def test_a_ratio_says_its_interval_and_whether_that_is_wide(
    measured: float | Ratio, interval: str, capsys: pytest.CaptureFixture[str]
) -> None:
    figure = Figure("speedup", measured, "how much faster", at_least=9.4)
    assert figure.is_met
    assert figure.interval == interval
    print_figures("placefield bench part", [figure])
    assert interval in capsys.readouterr().out


def test_two_figures_of_one_key_are_a_defect() -> None:
    with pytest.raises(ValueError, match="same key"):
        as_object([Figure("speedup", 9.5, ""), Figure("speedup", 8, "")])


def test_the_table_says_what_was_measured_and_whether_it_will_do(
    capsys: pytest.CaptureFixture[str],
) -> None:
    figures = [
        Figure("speedup", 9.5, "how much faster", at_least=8),
        Figure("frames_lost", 3, "of all", at_most=0),
        Figure("frames_per_s", 171.25, "through the services"),
    ]
    print_figures("placefield bench part", figures)
    out = capsys.readouterr().out
    lines = out.splitlines()
    rows = {cells[0]: cells[1:] for line in lines if len(cells := _cells(line)) == 4}
    assert rows["speedup"] == ["9.5", "≥ 8", "yes"]
    assert rows["frames_lost"] == ["3", "≤ 0", "no"]
    assert rows["frames_per_s"] == ["171.2", "", ""]
    for text in ("placefield bench part", "how much faster", "of all", "through the services"):
        assert text in out


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("│┃").split("│")]
