from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from placefield.evaluation.curves import PrecisionRecall, precision_recall
from placefield.evaluation.reliability import reliability
from placefield_tools.plots import (
    AucBar,
    ChannelCount,
    plot_auc_bars,
    plot_channel_counts,
    plot_precision_recall_panels,
    plot_reliability,
    style,
)

pytestmark = pytest.mark.filterwarnings("error")


def pixels(path: Path, colour: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the picture's pixels that have exactly this colour."""
    picture = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR_RGB))
    rows, columns = np.nonzero((picture == np.round(np.array(to_rgb(colour)) * 255)).all(axis=-1))
    return rows, columns


def a_curve(right: int, wrong: int) -> PrecisionRecall:
    correct = np.arange(right + wrong) < right
    yes = np.ones(right + wrong, dtype=bool)
    return precision_recall(correct, yes, yes, -np.arange(right + wrong, dtype=float))


def a_count(name: str, channels: int, auc: float, recall: float = 0.5) -> ChannelCount:
    spread = np.array([-0.01, 0.01])
    return ChannelCount(name, channels, auc + spread, recall + spread)


def test_bars_are_as_long_as_the_auc_and_the_recall(tmp_path: Path) -> None:
    path = tmp_path / "bars.png"

    plot_auc_bars(path, [AucBar("one", 0.8, 0.4, True), AucBar("two", 0.4, 0.2, True)])

    rows, columns = pixels(path, style.RIGHT)
    upper = columns[rows == rows.min() + 5]
    lower = columns[rows == rows.max() - 5]
    gap = int(np.diff(upper).argmax()) + 1
    lengths = [gap, len(upper) - gap, *np.diff([0, np.diff(lower).argmax() + 1, len(lower)])]
    assert np.array(lengths) / lengths[0] == pytest.approx([1, 0.5, 0.5, 0.25], abs=0.02)


def test_only_ours_is_coloured_and_what_failed_has_no_bar(tmp_path: Path) -> None:
    path = tmp_path / "bars.png"
    failed = AucBar("failed", None, None, True)

    plot_auc_bars(path, [AucBar("theirs", 0.8, 0.4, False), failed])
    assert not pixels(path, style.RIGHT)[0].size

    plot_auc_bars(path, [AucBar("ours", 0.8, 0.4, True), failed])
    assert pixels(path, style.RIGHT)[0].size


def test_more_auc_is_higher_up(tmp_path: Path) -> None:
    path = tmp_path / "counts.png"

    plot_channel_counts(path, [a_count("a", n, 0.5 + n / 20) for n in range(1, 11)])

    rows, columns = pixels(path, style.RIGHT)
    of_auc = (columns < columns.max() / 2) & (rows < 0.9 * rows.max())  # and not of the legend
    rows, columns = rows[of_auc], columns[of_auc]
    assert rows[columns == columns.min()].min() > rows[columns == columns.max()].max()


def test_lines_of_different_names_have_different_colours(tmp_path: Path) -> None:
    path = tmp_path / "counts.png"
    counts = [a_count(name, n, 0.9) for name in ("a", "b") for n in (1, 2)]

    plot_channel_counts(path, counts[:2])
    assert not pixels(path, style.WRONG)[0].size

    plot_channel_counts(path, counts)
    assert pixels(path, style.WRONG)[0].size


def test_a_probability_that_keeps_its_word_lies_on_the_diagonal(tmp_path: Path) -> None:
    path = tmp_path / "reliability.png"

    plot_reliability(path, reliability(np.full(4, 0.75), np.array([True, True, True, False])))
    assert not pixels(path, style.WRONG)[0].size

    plot_reliability(path, reliability(np.full(4, 0.75), np.array([True, False, False, False])))
    assert pixels(path, style.WRONG)[0].size > 100


def test_every_curve_has_a_panel(tmp_path: Path) -> None:
    path = tmp_path / "panels.png"
    curves = {f"method {n}": a_curve(n + 1, 2) for n in range(6)}

    plot_precision_recall_panels(path, curves, ours=["method 0", "method 5"])

    rows, columns = pixels(path, style.RIGHT)
    assert np.ptp(rows) > 200, "the sixth is in the second row of five each"
    assert np.ptp(columns) < 400, "and in the first column, under the first"


@pytest.mark.parametrize(
    "draw",
    [
        lambda path: plot_auc_bars(path, [AucBar("one", 0.0, 0.0, True)]),
        lambda path: plot_auc_bars(path, [AucBar("one", None, None, False)]),
        lambda path: plot_auc_bars(path, [AucBar("a long name " * 6, 1.0, 1.0, False)] * 9, "t"),
        lambda path: plot_channel_counts(path, [a_count("one", 1, 0.01, 0.01)]),
        lambda path: plot_channel_counts(
            path, [ChannelCount("one", 1, np.ones(1), np.zeros(1))], "title"
        ),
        lambda path: plot_reliability(path, reliability(np.empty(0), np.empty(0, np.bool_)), "t"),
        lambda path: plot_reliability(path, reliability(np.ones(1), np.ones(1, np.bool_), 1)),
        lambda path: plot_precision_recall_panels(path, {"one": a_curve(0, 3)}, []),
        lambda path: plot_precision_recall_panels(path, {"one": a_curve(3, 0)}, ["one"]),
    ],
)
def test_extremes_are_drawn(tmp_path: Path, draw: Callable[[Path], None]) -> None:
    path = tmp_path / "extreme.png"

    draw(path)

    assert path.read_bytes().startswith(b"\x89PNG")
