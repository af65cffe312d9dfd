"""Right is what GPS says to be near: against haversine, and from files as St Lucia has them."""

import logging
from itertools import pairwise
from math import asin, cos, isnan, nan, radians, sin, sqrt
from pathlib import Path
from shlex import split

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from placefield.errors import ConfigError, SourceError
from placefield.evaluation.truth import read_truth
from placefield_tools.cli.main import app
from placefield_tools.datasets.benchmarks import benchmark
from placefield_tools.datasets.checking import check
from placefield_tools.datasets.gps_truth import between_fixes, read_positions, runs_within

BRISBANE = (-27.504, 153.002)
NORTH = 1 / 110_800  # degrees to a metre there
EAST = 1 / 98_850
REFERENCE, QUERY = "100909_0845", "180809_1545"

Positions = list[tuple[float, float]]


def at(*metres: tuple[float, float]) -> Positions:
    """Return degrees of points in metres east and north."""
    return [(BRISBANE[0] + north * NORTH, BRISBANE[1] + east * EAST) for east, north in metres]


def haversine(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Return metres on a sphere, which is wrong by 0.4 % at most there."""
    (lat_a, lon_a), (lat_b, lon_b) = (map(radians, point) for point in (a, b))
    chord = sin((lat_b - lat_a) / 2) ** 2 + cos(lat_a) * cos(lat_b) * sin((lon_b - lon_a) / 2) ** 2
    return 2 * 6_371_000 * asin(sqrt(chord))


def assert_right(
    rows: set[tuple[int, int]], query: Positions, reference: Positions, metres: float
) -> None:
    """Compare pairs of frames that are right with haversine, but for those on the very edge."""
    distances = {
        (i, j): haversine(here, there)
        for i, here in enumerate(query)
        for j, there in enumerate(reference)
    }
    assert {pair for pair, distance in distances.items() if distance < 0.99 * metres} <= rows
    assert rows <= {pair for pair, distance in distances.items() if distance < 1.01 * metres}


def pairs(rows: list[tuple[int, int, int]]) -> set[tuple[int, int]]:
    return {(query, place) for query, first, last in rows for place in range(first, last + 1)}


def spread(positions: Positions) -> Positions:
    """Render literally: from the first frame of a fix to the first of the next, evenly."""
    firsts = [
        i
        for i, position in enumerate(positions)
        if not isnan(position[0]) and (i == 0 or position != positions[i - 1])
    ]
    out = []
    for i, position in enumerate(positions):
        begun = [first for first in firsts if first <= i]
        later = [first for first in firsts if first > i]
        if isnan(position[0]) or not later:
            out.append(position)
            continue
        share = (i - begun[-1]) / (later[0] - begun[-1])
        to = positions[later[0]]
        out.append(tuple(a + share * (b - a) for a, b in zip(position, to, strict=True)))
    return out


@pytest.mark.parametrize("metres", [2, 25, 60])
def test_right_are_the_frames_within_the_tolerance(metres: float) -> None:
    random = np.random.default_rng(1)
    query, reference = (
        at(*map(tuple, np.cumsum(random.normal(0, 6, (90, 2)), axis=0))) for _ in range(2)
    )
    rows = runs_within(np.array(query), np.array(reference), metres)
    assert_right(pairs(rows), query, reference, metres)
    assert rows == sorted(rows)
    for (query_a, _, last), (query_b, first, _) in pairwise(rows):
        assert query_a != query_b or first > last + 1, "runs that touch are one"


def test_a_street_that_is_taken_twice_is_right_both_times() -> None:
    there = [(10.0 * step, 0.0) for step in range(6)]
    back = [(10.0 * step, 4.0) for step in reversed(range(6))]
    query = np.array(at((0, 0), (30, 2), (50, 2)))
    rows = runs_within(query, np.array(at(*there, (300, 0), *back)), 12)
    assert rows == [(0, 0, 1), (0, 11, 12), (1, 2, 4), (1, 8, 10), (2, 4, 5), (2, 7, 8)]


def test_frames_whose_position_is_not_known_are_right_for_nothing() -> None:
    known = np.array(at((0, 0), (3, 0), (6, 0), (9, 0)))
    unknown = known.copy()
    unknown[1] = nan
    assert runs_within(unknown, known, 4) == [(0, 0, 1), (2, 1, 3), (3, 2, 3)]
    assert runs_within(known[1:2], unknown, 4) == [(0, 0, 0), (0, 2, 2)]
    assert runs_within(known, np.full((2, 2), nan), 4) == []
    assert runs_within(np.full((2, 2), nan), known, 4) == []


def test_latitudes_without_their_minus_change_nothing() -> None:
    random = np.random.default_rng(2)
    query, reference = np.array(at(*map(tuple, random.uniform(0, 100, (60, 2))))).reshape(2, 30, 2)
    mirror = np.array([-1, 1])
    assert runs_within(query * mirror, reference * mirror, 25) == runs_within(query, reference, 25)


def test_frames_between_two_fixes_lie_evenly_between_them() -> None:
    given = np.array([[1, 5], [1, 5], [2, 7], [2, 7], [2, 7], [2, 7], [nan, nan], [4, 7], [4, 7]])
    expected = [[1, 5], [1.5, 6], [2, 7], [2.4, 7], [2.8, 7], [3.2, 7], [nan, nan], [4, 7], [4, 7]]
    np.testing.assert_allclose(between_fixes(given), expected)
    literal = spread([(float(a), float(b)) for a, b in given])
    np.testing.assert_allclose(between_fixes(given), literal)
    apart = np.array([[1, 2], [3, 4], [nan, nan], [nan, nan], [9, 9]])
    np.testing.assert_array_equal(between_fixes(apart), apart)
    np.testing.assert_array_equal(between_fixes(apart[2:4]), apart[2:4])


def test_a_file_of_positions_is_read_line_by_line(tmp_path: Path) -> None:
    file = tmp_path / "fGPS.txt"
    file.write_bytes(
        b"27.50407166666666500000,153.00236500000000000000\r\n0,0\r\n0.00000000,0.00000000\r\n"
        b"NaN,NaN\r\n\r\n 27.5 , 153\r\n"
    )
    none = [nan, nan]
    expected = [[27.504071666666665, 153.002365], none, none, none, none, [27.5, 153]]
    np.testing.assert_array_equal(read_positions(file), expected)


@pytest.mark.parametrize(
    "line", ["27.5", "27.5,153,0", "27.5;153", "north,east", "27.5,", "153,27.5", "27,181", "inf,0"]
)
def test_a_line_that_is_no_position_is_reported(tmp_path: Path, line: str) -> None:
    file = tmp_path / "fGPS.txt"
    file.write_text(f"27.5,153\n\n{line}\n27.5,153\n")
    with pytest.raises(SourceError) as reported:
        read_positions(file)
    assert str(reported.value) == (
        f"{file}:3: {line!r} is not latitude,longitude in degrees; get the file again"
    )


def test_a_file_that_has_no_positions_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "fGPS.txt"
    with pytest.raises(SourceError, match=r"fGPS.txt: cannot be read: No such file"):
        read_positions(file)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(SourceError, match=r"fGPS.txt: is no text; get it again"):
        read_positions(file)
    for nothing in ("", "\n\n0,0\n"):
        file.write_text(nothing)
        with pytest.raises(SourceError, match=r"fGPS.txt: has no fix of any frame; get it again"):
            read_positions(file)


def block(metres: float, beside: float) -> Positions:
    """Return fixes, 9 m apart, of so many metres around a block of 60 m, so far to a side."""
    sides = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    east, north, fixes = -beside, -beside, []
    for step in range(int(metres // 9)):
        fixes.append((east, north))
        x, y = sides[step * 9 // 60 % 4]
        east, north = east + 9 * x, north + 9 * y
    return at(*fixes)


def filmed(fixes: Positions, repeats: list[int]) -> Positions:
    """Repeat every fix for so many frames, in turn; one frame in the middle has none."""
    lines = [fix for number, fix in enumerate(fixes) for _ in range(repeats[number % len(repeats)])]
    lines[len(lines) // 2] = (nan, nan)
    return lines


def write_drive(folder: Path, positions: Positions, frames: int) -> None:
    folder.mkdir(parents=True)
    lines = ["0,0" if isnan(lat) else f"{-lat:.20f},{lon:.20f}" for lat, lon in positions]
    (folder / "fGPS.txt").write_text("".join(f"{line}\r\n" for line in lines))
    film = cv2.VideoWriter(
        str(folder / "webcam_video.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 15, (32, 24)
    )
    for number in range(frames):
        film.write(np.full((24, 32, 3), number, np.uint8))
    film.release()


@pytest.fixture
def reference() -> Positions:
    return filmed(block(330, beside=0), [3, 2, 4])


@pytest.fixture
def query() -> Positions:
    return [*filmed(block(200, beside=2), [5, 3]), *at((500, 500), (500, 509))]


@pytest.fixture
def drives(tmp_path: Path, reference: Positions, query: Positions) -> Path:
    """St Lucia as it lies in a folder: the reference is driven one time around and a half."""
    write_drive(tmp_path / REFERENCE, reference, len(reference))
    write_drive(tmp_path / QUERY, query, len(query))
    return tmp_path


def run(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["datasets", *arguments], catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


@pytest.mark.parametrize(("metres", "flags"), [(25, ()), (4, ("--tolerance", "4m"))])
def test_the_command_makes_the_truth_of_a_benchmark(
    drives: Path, reference: Positions, query: Positions, metres: float, flags: tuple[str, ...]
) -> None:
    reported = run("truth", "st-lucia", str(drives), *flags)
    truth = read_truth(drives / "truth.csv", len(query), len(reference))
    rows = list(zip(truth.query.tolist(), truth.first.tolist(), truth.last.tolist(), strict=True))
    assert_right(pairs(rows), spread(query), spread(reference), metres)
    assert max(np.bincount(truth.query)) >= 2, "the loop is closed"
    placed = int(truth.on_route.sum())
    assert not truth.on_route[[-1, -2]].any()
    assert 0 < placed < len(query) - 2, "one frame has no fix"
    table, command = reported.splitlines()
    assert table == (
        f"{drives}/truth.csv: {placed} of {len(query)} query frames have a place within {metres} m"
    )
    films = [f"{drives}/{name}/webcam_video.avi" for name in (REFERENCE, QUERY)]
    assert split(command) == ["placefield", "study", *films, "--truth", f"{drives}/truth.csv"]


def test_checking_says_how_to_make_the_truth_and_what_it_wants(drives: Path) -> None:
    known = benchmark("st-lucia")
    made = f"no ground truth truth.csv, which 'placefield datasets truth st-lucia {drives}' makes"
    with pytest.raises(SourceError, match=f"as st-lucia: {made}; see"):
        check(known, drives)
    run("truth", "st-lucia", str(drives))
    assert f"--truth {drives}/truth.csv" in run("check", "st-lucia", str(drives))
    (drives / QUERY / "fGPS.txt").unlink()
    with pytest.raises(SourceError, match=f"as st-lucia: no {QUERY}/fGPS.txt; see"):
        check(known, drives)


def test_showing_says_how_to_make_the_truth() -> None:
    shown = run("show", "st-lucia")
    assert "to make it:   placefield datasets truth st-lucia st-lucia\n" in shown
    assert "--truth st-lucia/truth.csv" in shown
    assert "to make it" not in run("show", "gardens-point")


@pytest.mark.parametrize("more", [-4, 7])
def test_other_numbers_of_lines_and_frames_are_reported_and_taken_from_the_first_on(
    tmp_path: Path,
    reference: Positions,
    query: Positions,
    caplog: pytest.LogCaptureFixture,
    more: int,
) -> None:
    write_drive(tmp_path / REFERENCE, reference, len(reference) + more)
    write_drive(tmp_path / QUERY, query, len(query) + more)
    with caplog.at_level(logging.WARNING):
        run("truth", "st-lucia", str(tmp_path))
    assert [record.getMessage().partition("; ")[0] for record in caplog.records] == [
        f"{tmp_path}/{name}/fGPS.txt: has {lines} lines for the {lines + more} frames of "
        "webcam_video.avi"
        for name, lines in ((REFERENCE, len(reference)), (QUERY, len(query)))
    ]
    truth = read_truth(tmp_path / "truth.csv", len(query) + more, len(reference) + more)
    assert truth.on_route[0]
    assert truth.last.max() == len(reference) + min(more, 0) - 1


def test_what_cannot_be_made_is_reported(drives: Path, query: Positions) -> None:
    def refused(*arguments: str) -> str:
        with pytest.raises((SourceError, ConfigError)) as reported:
            run("truth", *arguments)
        assert "\n" not in str(reported.value)
        return str(reported.value)

    assert refused("nordland", str(drives)).startswith("nordland: its ground truth is not made")
    for wrong in ("2", "0m", "-2m", "near"):
        assert refused("st-lucia", str(drives), "--tolerance", wrong) == (
            f"--tolerance {wrong!r}: write metres as 2.5m"
        )
    far = [(lat + 1, lon) for lat, lon in query]
    (drives / QUERY / "fGPS.txt").write_text("".join(f"{-lat},{lon}\n" for lat, lon in far))
    assert refused("st-lucia", str(drives)) == (
        f"{drives}: no frame of the query is within 25 m of the reference, by {QUERY}/fGPS.txt; "
        "check that both drives are of one route"
    )
    (drives / QUERY / "webcam_video.avi").unlink()
    assert f"{drives}/{QUERY}/webcam_video.avi" in refused("st-lucia", str(drives))
    (drives / REFERENCE / "fGPS.txt").unlink()
    assert refused("st-lucia", str(drives)).startswith(f"{drives}/{REFERENCE}/fGPS.txt: cannot")
    assert not list(drives.glob("truth.csv*"))
