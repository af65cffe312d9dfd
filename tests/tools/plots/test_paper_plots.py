from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from sklearn.decomposition import PCA

from placefield_tools.plots import (
    ChannelSegments,
    Neighbourhood,
    autocorrelation,
    count_invaders,
    firing,
    plane_positions,
    plot_autocorrelograms,
    plot_clusters,
    plot_groups,
    plot_neighbourhood,
)
from placefield_tools.plots.clusters import sample_places, sample_segments
from placefield_tools.plots.groups import GroupPiece, pieces
from placefield_tools.plots.runs import ACTIVE, INACTIVE, runs_of

pytestmark = pytest.mark.filterwarnings("error")

Picture = NDArray[np.uint8]
YELLOW = "#f0e442"
GREEN = "#00ff00"


def read_png(path: Path) -> Picture:
    """Read a picture as RGB, and hold it to be a PNG of a size that a page can show."""
    assert path.read_bytes().startswith(b"\x89PNG")
    picture = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR_RGB), dtype=np.uint8)
    height, width = picture.shape[:2]
    assert 9 * 150 <= width <= 11 * 150
    assert 100 <= height <= 2000
    return picture


def pixels(picture: Picture, colour: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the pixels that have exactly this colour."""
    wanted = np.round(np.array(to_rgb(colour)) * 255)
    rows, columns = np.nonzero((picture == wanted).all(axis=-1))
    return rows, columns


def a_channel(*lengths: int) -> ChannelSegments:
    """A channel of segments that are so long; a negative length is of an inactive one."""
    label = np.repeat([n if k > 0 else 0 for n, k in enumerate(lengths, 1)], np.abs(lengths))
    return ChannelSegments("channel", 1.1, label, label > 0)


def a_grey(place: int) -> Picture:
    return np.full((30, 40), 20 + place % 200, dtype=np.uint8)


def only_green(wanted: int) -> Callable[[int], Picture]:
    """Give frames of which only that of one place is green."""
    green = np.zeros((30, 40, 3), dtype=np.uint8)
    green[..., 1] = 255
    return lambda place: green if place == wanted else np.zeros_like(green)


def a_neighbourhood(
    offsets: list[list[float]], same: list[int], targets: list[int], margin: float = 0
) -> Neighbourhood:
    return Neighbourhood(
        "metric", np.array(offsets), np.array(same) > 0, np.array(targets) > 0, margin
    )


def some_neighbourhood(seed: int = 1, frames: int = 50, dimensions: int = 8) -> Neighbourhood:
    random = np.random.default_rng(seed)
    same = random.random(frames) < 0.3
    offsets = random.normal(size=(frames, dimensions)) * np.linspace(3, 1, dimensions)
    distance = np.where(same, np.linalg.norm(offsets, axis=1), np.inf)
    targets = same & (distance <= np.sort(distance)[2])
    return Neighbourhood("metric", offsets, same, targets, margin=5.0)


# Clusters


def test_segments_are_chosen_evenly_by_length_from_the_shortest_to_the_longest() -> None:
    runs = runs_of(a_channel(4, 10, -2, 7, 4, 20))

    assert sample_segments(runs, 2) == [0, 5]
    assert sample_segments(runs, 3) == [0, 1, 5]
    assert sample_segments(runs, 4) == [0, 1, 3, 5]
    assert sample_segments(runs, 9) == [0, 1, 3, 4, 5]


def test_segments_of_one_length_are_chosen_all_over_the_route() -> None:
    assert sample_segments(runs_of(a_channel(*[5] * 9)), 3) == [0, 4, 8]


@pytest.mark.parametrize(
    ("start", "length", "places"),
    [(10, 9, [10, 12, 14, 16, 18]), (10, 3, [10, 11, 12]), (10, 1, [10]), (0, 5, [0, 1, 2, 3, 4])],
)
def test_frames_of_a_segment_go_evenly_from_its_first_to_its_last(
    start: int, length: int, places: list[int]
) -> None:
    assert sample_places(start, length).tolist() == places


def test_the_route_is_a_bar_above_the_frames_of_its_segments_in_order(tmp_path: Path) -> None:
    path = tmp_path / "clusters.png"

    def picture_of(place: int) -> Picture:
        return np.full((30, 40, 3), (place, 200, 255), dtype=np.uint8)

    plot_clusters(path, a_channel(10, -10, 20), picture_of, "title")

    picture = read_png(path)
    bar = [pixels(picture, colour) for colour in (ACTIVE[1], INACTIVE, ACTIVE[0])]
    row = int(bar[1][0].min()) + 3
    shares = np.array([np.count_nonzero(rows == row) for rows, _ in bar])
    assert shares / shares.sum() == pytest.approx([0.25, 0.25, 0.5], abs=0.01)
    first, last, later = (pixels(picture, f"#ffc8{place:02x}") for place in (0, 9, 20))
    assert row < first[0].min()
    assert first[0].min() == last[0].min() < first[0].max() < later[0].min()
    assert first[1].max() < last[1].min(), "the segment's last frame is at the right"
    assert first[0].size == pytest.approx(later[0].size, rel=0.05)


def test_of_a_segment_only_the_frames_that_are_drawn_are_asked_for(tmp_path: Path) -> None:
    asked: list[int] = []

    def picture_of(place: int) -> Picture:
        asked.append(place)
        return a_grey(place)

    plot_clusters(tmp_path / "clusters.png", a_channel(-3, 9, 2), picture_of)

    assert asked == [3, 5, 7, 9, 11, 12, 13]


def test_a_frame_keeps_its_colours(tmp_path: Path) -> None:
    path = tmp_path / "clusters.png"
    blue = np.zeros((30, 40, 3), dtype=np.uint8)
    blue[..., 0] = 255

    plot_clusters(path, a_channel(5), lambda place: blue)

    assert pixels(read_png(path), "#0000ff")[0].size > 10_000


def test_a_channel_without_active_segments_is_a_bar(tmp_path: Path) -> None:
    path = tmp_path / "clusters.png"

    plot_clusters(path, a_channel(-20), a_grey)

    picture = read_png(path)
    assert len(picture) < 300
    assert np.ptp(pixels(picture, INACTIVE)[1]) > 0.9 * picture.shape[1]


# Groups


def test_a_group_is_cut_where_a_line_ends() -> None:
    runs = runs_of(a_channel(5, -3, 8))

    assert list(pieces(runs, 2, 7)) == [
        GroupPiece(0, first=2, last=4, begins=False, ends=True),
        GroupPiece(1, first=5, last=6, begins=True, ends=False),
    ]
    assert list(pieces(runs, 7, 12)) == [
        GroupPiece(1, first=7, last=7, begins=False, ends=True),
        GroupPiece(2, first=8, last=11, begins=True, ends=False),
    ]


def test_frames_of_a_group_are_on_one_band_and_groups_are_apart(tmp_path: Path) -> None:
    path = tmp_path / "groups.png"

    plot_groups(path, {"row": a_channel(5, -3, 4)}, 0, a_grey, 12)

    picture = read_png(path)
    bands = [pixels(picture, colour) for colour in (ACTIVE[1], INACTIVE, ACTIVE[0])]
    row = int(bands[0][0].min()) + 3
    columns = [np.sort(columns[rows == row]) for rows, columns in bands]
    assert all((np.diff(band) == 1).all() for band in columns), "a band has no gap"
    gaps = [right[0] - left[-1] for left, right in pairwise(columns)]
    assert min(gaps) > 5
    lengths = np.array([len(band) for band in columns])
    assert lengths / lengths.sum() == pytest.approx([5 / 12, 3 / 12, 4 / 12], abs=0.01)


def test_every_row_shows_the_same_places(tmp_path: Path) -> None:
    path = tmp_path / "groups.png"
    rows = {"one": a_channel(30), "two": a_channel(10, 20), "three": a_channel(-30)}

    plot_groups(path, {"one": rows["one"]}, 8, only_green(12), 6)
    once = pixels(read_png(path), GREEN)
    plot_groups(path, rows, 8, only_green(12), 6)
    thrice = pixels(read_png(path), GREEN)

    assert thrice[0].size == pytest.approx(3 * once[0].size, rel=0.05)
    assert np.ptp(thrice[1]) == pytest.approx(np.ptp(once[1]), abs=2), "under one another"


def test_the_thirteenth_frame_begins_a_line(tmp_path: Path) -> None:
    path = tmp_path / "groups.png"

    plot_groups(path, {"row": a_channel(40)}, 10, only_green(22), 20)

    picture = read_png(path)
    rows, columns = pixels(picture, GREEN)
    assert columns.max() < picture.shape[1] / 10
    assert rows.min() > len(picture) / 2


@pytest.mark.parametrize(("first", "count"), [(-1, 5), (0, 0), (6, 5), (0, 11)])
def test_places_that_are_not_there_are_refused(tmp_path: Path, first: int, count: int) -> None:
    with pytest.raises(ValueError, match="row has places 0 to 9"):
        plot_groups(tmp_path / "groups.png", {"row": a_channel(10)}, first, a_grey, count)


def test_no_row_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no cut"):
        plot_groups(tmp_path / "groups.png", {}, 0, a_grey)


@pytest.mark.parametrize(
    "frame",
    [
        np.zeros((0, 4), np.uint8),
        np.zeros((4, 4, 2), np.uint8),
        np.zeros(4, np.uint8),
        np.zeros((4, 4), np.float32),
    ],
)
def test_a_frame_that_is_no_picture_is_refused(tmp_path: Path, frame: Picture) -> None:
    path = tmp_path / "broken.png"

    with pytest.raises(ValueError, match="the frame of place 0"):
        plot_groups(path, {"row": a_channel(30)}, 0, lambda place: frame)
    with pytest.raises(ValueError, match="the frame of place 0"):
        plot_clusters(path, a_channel(30), lambda place: frame)
    assert not path.exists()


# Neighbourhood


def test_an_invader_has_another_label_and_is_nearer_than_the_farthest_target() -> None:
    around = a_neighbourhood(
        [[2, 0], [0, 1], [1, 1], [0, 2], [0, -2.5], [3, 0], [1, 0]],
        same=[1, 1, 0, 0, 0, 0, 1],
        targets=[1, 1, 0, 0, 0, 0, 0],
        margin=2.5,
    )

    assert count_invaders(around) == 1
    assert count_invaders(around, with_margin=True) == 3


def test_invaders_are_those_that_the_push_of_lmnn_counts() -> None:
    around = some_neighbourhood()
    squared = [sum(x * x for x in offset) for offset in around.offsets.tolist()]
    farthest = max(d for d, target in zip(squared, around.targets, strict=True) if target)

    def pushed(margin: float) -> int:
        others = [d for d, same in zip(squared, around.same, strict=True) if not same]
        return sum(max(0.0, margin + farthest - d) > 0 for d in others)

    assert count_invaders(around) == pushed(0) > 0
    assert count_invaders(around, with_margin=True) == pushed(5.0) > pushed(0)


def test_distances_in_the_plane_are_true_and_in_those_of_the_farthest_target() -> None:
    around = some_neighbourhood()

    radius = np.hypot(*plane_positions(around).T)

    distance = np.linalg.norm(around.offsets, axis=1)
    assert radius == pytest.approx(distance / distance[around.targets].max())
    assert radius[around.targets].max() == pytest.approx(1)


def test_directions_in_the_plane_are_those_of_the_principal_components() -> None:
    around = some_neighbourhood()
    components = PCA(2).fit(around.offsets).components_

    positions = plane_positions(around)

    projected = around.offsets @ components.T
    projected *= np.sign(projected[0]) * np.sign(positions[0])  # PCA's signs are its own
    projected /= np.linalg.norm(projected, axis=1, keepdims=True)
    assert positions / np.linalg.norm(positions, axis=1, keepdims=True) == pytest.approx(projected)


def test_the_sign_of_a_direction_does_not_hang_on_the_sign_of_the_offsets() -> None:
    around = some_neighbourhood()

    mirrored = plane_positions(replace(around, offsets=-around.offsets))

    assert mirrored == pytest.approx(-plane_positions(around))


@pytest.mark.parametrize("offset", [[2.0], [3.0, 4.0], [0.0, 0.0, 5.0]])
def test_a_single_frame_has_a_position(offset: list[float]) -> None:
    position = plane_positions(a_neighbourhood([offset], [1], [1]))

    assert np.linalg.norm(position) == pytest.approx(1)


def test_an_invader_is_drawn_within_the_circle_and_on_its_side(tmp_path: Path) -> None:
    path = tmp_path / "neighbourhood.png"
    before = a_neighbourhood([[2, 0], [-1, 0], [0, 0.1]], [1, 0, 0], [1, 0, 0], margin=1.0)
    after = replace(before, offsets=np.array([[1, 0], [-2, 0], [0, 2]]))

    plot_neighbourhood(path, before, after, "title")

    picture = read_png(path)
    of_legend = 0.85 * len(picture)
    (rows, red), (lines, yellow) = (pixels(picture, colour) for colour in (ACTIVE[0], YELLOW))
    red, yellow = red[rows < of_legend], yellow[lines < of_legend]
    middle = picture.shape[1] / 2
    reach_before = yellow[yellow < middle].min(), red[red < middle].max()
    reach_after = yellow[yellow > middle].min(), red[red > middle].max()
    ink = red[red < middle].min(), red[red > middle].min()  # where the target's line begins
    assert (ink[0] - reach_before[0]) < 0.7 * (reach_before[1] - ink[0])
    assert (ink[1] - reach_after[0]) > 1.5 * (reach_after[1] - ink[1])


def test_many_frames_of_many_dimensions_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "neighbourhood.png"

    plot_neighbourhood(path, some_neighbourhood(1, 500, 100), some_neighbourhood(2, 4, 3))

    read_png(path)


@pytest.mark.parametrize(
    ("around", "complaint"),
    [
        (a_neighbourhood([[1, 0], [2, 0]], [1, 0], [0, 0]), "no target neighbour"),
        (a_neighbourhood([[1, 0], [2, 0]], [1, 0], [0, 1]), "another label"),
        (a_neighbourhood([[0, 0], [2, 0]], [1, 0], [1, 0]), "at no distance"),
        (a_neighbourhood([[1, 0], [np.nan, 0]], [1, 0], [1, 0]), "not finite"),
        (a_neighbourhood([[1, 0], [2, 0]], [1, 0, 0], [1, 0, 0]), "do not go with"),
        (a_neighbourhood([[1, 0], [2, 0]], [1, 0], [1, 0], margin=-1), "negative"),
    ],
)
def test_a_broken_neighbourhood_is_refused(
    tmp_path: Path, around: Neighbourhood, complaint: str
) -> None:
    for refuse in (count_invaders, plane_positions):
        with pytest.raises(ValueError, match=complaint):
            refuse(around)
    with pytest.raises(ValueError, match=complaint):
        plot_neighbourhood(tmp_path / "broken.png", some_neighbourhood(), around)


# Autocorrelograms


def test_a_cell_fires_in_every_second_active_segment() -> None:
    rate = firing(a_channel(2, 3, -1, 1, -2, 2, 1))

    assert rate.tolist() == [1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def test_the_autocorrelation_is_pearsons_over_what_is_there_twice() -> None:
    rate = np.random.default_rng(1).random(30)

    found = autocorrelation(rate, 20)

    for shift in range(1, 21):
        expected = np.corrcoef(rate[shift:], rate[:-shift])[0, 1]
        assert found[20 + shift] == pytest.approx(expected)
        assert found[20 - shift] == pytest.approx(expected)
    assert found[20] == pytest.approx(1)
    assert found.shape == (41,)


@pytest.mark.parametrize("length", [3, 8])
def test_a_regular_cut_repeats_after_two_segments(length: int) -> None:
    most = 5 * length

    found = autocorrelation(firing(a_channel(*[length] * 12)), most)

    at = {shift: found[most + shift] for shift in range(-most, most + 1)}
    peaks = [
        shift for shift in range(-most + 1, most) if at[shift] > max(at[shift - 1], at[shift + 1])
    ]
    assert peaks == [-4 * length, -2 * length, 0, 2 * length, 4 * length]
    assert [at[shift] for shift in peaks] == pytest.approx([1] * 5)
    assert at[length] == at[-length] == pytest.approx(-1)


def test_what_does_not_vary_is_not_correlated() -> None:
    assert autocorrelation(np.full(5, 0.1), 3).tolist() == [0] * 7
    assert autocorrelation(np.array([0.0, 1.0]), 1).tolist() == pytest.approx([0, 1, 0])


@pytest.mark.parametrize("most", [-1, 5, 6])
def test_a_shift_past_the_route_is_refused(tmp_path: Path, most: int) -> None:
    with pytest.raises(ValueError, match="5 places cannot be shifted"):
        autocorrelation(np.arange(5.0), most)
    with pytest.raises(ValueError, match="5 places cannot be shifted"):
        plot_autocorrelograms(tmp_path / "auto.png", [a_channel(2, 3), a_channel(9)], most)


def test_fields_of_longer_segments_are_wider(tmp_path: Path) -> None:
    path = tmp_path / "autocorrelograms.png"
    widths = []

    for length in (5, 10):
        plot_autocorrelograms(path, [a_channel(*[length] * 20)], 15, "title")
        rows, columns = pixels(read_png(path), "#67001f")  # the darkest red, a correlation of 1
        strip = columns[rows == rows[len(rows) // 2]]
        widths.append(np.ptp(strip) / np.unique(np.diff(strip)).size)

    # Of segments of 5 the strip shows -10, 0 and 10; of 10 only 0 is as dark.
    assert widths[0] > 5 * widths[1]


def test_no_channel_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no channel"):
        plot_autocorrelograms(tmp_path / "auto.png", [])


# All of them

AT_ONE = a_neighbourhood([[1.0]], [1], [1])
FAR = a_neighbourhood([[1e-9], [1.0]], [1, 0], [1, 0])


@pytest.mark.parametrize(
    "draw",
    [
        lambda path: plot_clusters(path, a_channel(1), a_grey),
        lambda path: plot_clusters(path, a_channel(*[1, 2, 3] * 400), a_grey, "title"),
        lambda path: plot_clusters(path, a_channel(-1200, 1, 1, 1, 1, 1, 1, 1), a_grey),
        lambda path: plot_groups(path, {"row": a_channel(1)}, 0, a_grey, 1),
        lambda path: plot_groups(path, {"row": a_channel(*[1, -1] * 20)}, 3, a_grey, 36, "title"),
        lambda path: plot_autocorrelograms(path, [a_channel(1)]),
        lambda path: plot_autocorrelograms(path, [a_channel(-30), a_channel(30)]),
        lambda path: plot_autocorrelograms(path, [a_channel(*[7] * 300)] * 8, title="title"),
        lambda path: plot_neighbourhood(path, AT_ONE, AT_ONE),
        lambda path: plot_neighbourhood(path, replace(AT_ONE, margin=1e6), AT_ONE, "title"),
        lambda path: plot_neighbourhood(path, FAR, AT_ONE),
    ],
)
def test_extremes_are_drawn(tmp_path: Path, draw: Callable[[Path], None]) -> None:
    path = tmp_path / "extreme.png"

    draw(path)

    read_png(path)


@pytest.mark.parametrize(
    "broken",
    [
        ChannelSegments("broken", 1.1, np.arange(0), np.zeros(0, np.bool_)),
        ChannelSegments("broken", 1.1, np.arange(5), np.zeros(1, np.bool_)),
        ChannelSegments("broken", 1.1, np.zeros((2, 2), int), np.zeros((2, 2), np.bool_)),
    ],
)
def test_a_broken_channel_is_refused(tmp_path: Path, broken: ChannelSegments) -> None:
    path = tmp_path / "broken.png"

    with pytest.raises(ValueError, match="broken has labels of shape"):
        plot_clusters(path, broken, a_grey)
    with pytest.raises(ValueError, match="broken has labels of shape"):
        plot_groups(path, {"row": broken}, 0, a_grey, 1)
    with pytest.raises(ValueError, match="broken has labels of shape"):
        plot_autocorrelograms(path, [broken])
    assert not path.exists()


@pytest.mark.parametrize(
    "plot",
    [
        lambda path: plot_clusters(path, a_channel(5, -2, 9), a_grey, "title"),
        lambda path: plot_groups(path, {"row": a_channel(5, -2, 9)}, 0, a_grey, 16),
        lambda path: plot_neighbourhood(path, some_neighbourhood(1), some_neighbourhood(2)),
        lambda path: plot_autocorrelograms(path, [a_channel(5, -2, 9)]),
    ],
)
def test_the_same_input_gives_the_same_bytes(tmp_path: Path, plot: Callable[[Path], None]) -> None:
    plot(tmp_path / "first.png")
    plot(tmp_path / "second.png")

    assert (tmp_path / "first.png").read_bytes() == (tmp_path / "second.png").read_bytes()
