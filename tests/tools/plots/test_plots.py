from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from placefield.evaluation.curves import PrecisionRecall, precision_recall
from placefield_tools.plots import (
    AlignedTraverse,
    ChannelSegments,
    MatchPair,
    plot_alignment,
    plot_distance_matrix,
    plot_match_pairs,
    plot_precision_recall,
    plot_segments,
    style,
)

Picture = NDArray[np.uint8]


def read_png(path: Path) -> Picture:
    """Read a picture as RGB, and hold it to be a PNG of a size that a page can show."""
    assert path.read_bytes().startswith(b"\x89PNG")
    picture = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR_RGB), dtype=np.uint8)
    height, width = picture.shape[:2]
    assert 900 <= width <= 2000
    assert 80 <= height <= 4000
    return picture


def pixels(picture: Picture, colour: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the pixels that have exactly this colour."""
    wanted = np.round(np.array(to_rgb(colour)) * 255)
    rows, columns = np.nonzero((picture == wanted).all(axis=-1))
    return rows, columns


def a_curve() -> PrecisionRecall:
    yes = np.ones(4, dtype=bool)
    return precision_recall(np.array([True, True, False, True]), yes, yes, np.arange(4.0)[::-1])


def a_channel(label: list[int]) -> ChannelSegments:
    """A channel whose label 0 is the inactive one."""
    return ChannelSegments("channel", 1.1, np.array(label), np.array(label) > 0)


def a_pair(image: Picture, *, correct: bool) -> MatchPair:
    return MatchPair(image, image, query=3, place=5, correct=correct, score=0.25)


def test_every_curve_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "curves.png"
    names = ["one", "two", "three"]

    plot_precision_recall(path, {name: a_curve() for name in names[:1]}, "title")
    blue_alone = len(pixels(read_png(path), "#0072b2")[0])
    plot_precision_recall(path, {name: a_curve() for name in names}, "title")

    assert blue_alone > 500
    for colour in ("#0072b2", "#d55e00", "#009e73"):
        assert len(pixels(read_png(path), colour)[0]) > 0


def matrix_without_legend(path: Path) -> Picture:
    picture = read_png(path)
    return picture[: int(0.9 * len(picture))]


def test_query_frames_run_to_the_right_and_places_upwards(tmp_path: Path) -> None:
    path = tmp_path / "matrix.png"
    matches = np.full(60, 55)
    distances = np.ones((60, 70), dtype=np.float32)
    distances[:, 50:60] = 0

    plot_distance_matrix(path, distances, matches, np.ones(60, dtype=bool), "title")

    picture = matrix_without_legend(path)
    rows, columns = pixels(picture, style.RIGHT)
    assert rows.max() < len(picture) / 3
    assert np.ptp(columns) > 0.7 * picture.shape[1]
    assert picture[rows.min() - 20, columns[0] + 5].mean() < 128, "near is dark, under the matches"


def test_right_wrong_and_unanswered_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "matrix.png"
    distances = np.random.default_rng(1).random((20, 30)).astype(np.float32)
    distances[0], distances[1] = np.inf, np.nan
    everywhere, nowhere = np.ones(20, dtype=bool), np.zeros(20, dtype=bool)

    def drawn(matches: NDArray[np.int64], correct: NDArray[np.bool_]) -> tuple[bool, bool]:
        plot_distance_matrix(path, distances, matches, correct, "title")
        picture = matrix_without_legend(path)
        return bool(pixels(picture, style.RIGHT)[0].size), bool(
            pixels(picture, style.WRONG)[0].size
        )

    assert drawn(np.arange(20), everywhere) == (True, False)
    assert drawn(np.arange(20), nowhere) == (False, True)
    assert drawn(np.full(20, -1), nowhere) == (False, False)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("shape", [(0, 5), (1, 1), (3, 4)])
def test_a_matrix_with_nothing_to_see_is_drawn(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = tmp_path / "matrix.png"
    matches = np.full(shape[0], -1)

    plot_distance_matrix(path, np.full(shape, np.nan, np.float32), matches, matches >= 0, "title")

    read_png(path)


def test_pairs_are_marked_and_keep_their_colours(tmp_path: Path) -> None:
    path = tmp_path / "pairs.png"
    red = np.zeros((48, 64, 3), dtype=np.uint8)
    red[..., 2] = 255
    grey = np.full((30, 60), 77, dtype=np.uint8)

    plot_match_pairs(path, [a_pair(red, correct=True), a_pair(grey, correct=False)])

    picture = read_png(path)
    assert np.median(pixels(picture, "#ff0000")[0]) < len(picture) / 2
    assert np.median(pixels(picture, "#4d4d4d")[0]) > len(picture) / 2
    assert pixels(picture, style.RIGHT)[0].max() < pixels(picture, style.WRONG)[0].min()


def test_no_pairs_give_a_picture_that_says_so(tmp_path: Path) -> None:
    path = tmp_path / "pairs.png"

    plot_match_pairs(path, [])

    assert len(pixels(read_png(path), style.INK)[0]) > 0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("channels", [1, 3])
def test_neighbouring_segments_differ_in_tone_and_inactive_ones_are_blue(
    tmp_path: Path, channels: int
) -> None:
    path = tmp_path / "segments.png"
    label = [1] * 10 + [2] * 20 + [0] * 5 + [3] * 15

    plot_segments(path, [a_channel(label)] * channels, places=50)

    # The first bar: the topmost row that is coloured over most of the route.
    picture = read_png(path)
    tones = [pixels(picture, colour) for colour in ("#b2182b", "#ef8a73", "#a9c3de")]
    top = min(int(rows.min()) for rows, _ in tones) + 3
    bar = np.concatenate([np.unique(columns[rows == top]) for rows, columns in tones])
    lengths = [np.unique(columns[rows == top]).size / bar.size for rows, columns in tones]
    assert lengths == pytest.approx([20 / 50, 25 / 50, 5 / 50], abs=0.01)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("label", [[0] * 30, [1] * 300, list(range(1, 31)), [7]])
def test_extreme_segmentations_are_drawn(tmp_path: Path, label: list[int]) -> None:
    path = tmp_path / "segments.png"

    plot_segments(path, [a_channel(label)], places=len(label))

    read_png(path)


def test_a_fuzzifier_is_reported_as_in_the_table(tmp_path: Path) -> None:
    channel = a_channel([1, 1, 2, 0])
    paths = {fuzzifier: tmp_path / f"{fuzzifier}.png" for fuzzifier in (1.14667, 1.15, 1.16)}

    for fuzzifier, path in paths.items():
        plot_segments(path, [replace(channel, fuzzifier=fuzzifier)], places=4)

    reported, same, other = (path.read_bytes() for path in paths.values())
    assert reported == same != other


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("places", [[3, 4, -1, 6], [-1], [0] * 30], ids=["gap", "none", "stop"])
def test_each_frame_is_drawn_at_its_place_or_as_left_out(tmp_path: Path, places: list[int]) -> None:
    path = tmp_path / "alignment.png"
    plot_alignment(path, [AlignedTraverse("night$: 4", np.array(places, np.int32))], places=8)
    picture = read_png(path)
    assert len(pixels(picture, style.RIGHT)[0]) > 0 or max(places) < 0
    assert len(pixels(picture, style.WRONG)[0]) > 0 or min(places) >= 0


def test_no_traverse_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no traverse"):
        plot_alignment(tmp_path / "alignment.png", [], places=10)


def test_no_channel_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no channel"):
        plot_segments(tmp_path / "segments.png", [], places=10)


@pytest.mark.parametrize(
    "plot",
    [
        lambda path: plot_precision_recall(path, {"one": a_curve()}, "title"),
        lambda path: plot_segments(path, [a_channel([1, 1, 2, 0])], places=4),
    ],
)
def test_the_same_input_gives_the_same_bytes(tmp_path: Path, plot: Callable[[Path], None]) -> None:
    plot(tmp_path / "first.png")
    plot(tmp_path / "second.png")

    assert (tmp_path / "first.png").read_bytes() == (tmp_path / "second.png").read_bytes()
