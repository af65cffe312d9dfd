from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.errors import TruthError
from placefield.evaluation.truth import Truth, read_truth


@given(
    queries=st.integers(0, 12),
    places=st.integers(0, 12),
    tolerance=st.integers(0, 5),
    data=st.data(),
)
def test_within_is_right_exactly_where_frame_numbers_differ_by_the_tolerance_at_most(
    queries: int, places: int, tolerance: int, data: st.DataObject
) -> None:
    matches = data.draw(
        st.lists(st.integers(-1, places - 1), min_size=queries, max_size=queries), label="matches"
    )
    truth = Truth.within(queries, places, tolerance)

    correct = truth.correct(np.array(matches, dtype=np.int64))

    assert correct.tolist() == [m >= 0 and abs(m - i) <= tolerance for i, m in enumerate(matches)]
    assert truth.on_route.tolist() == [
        any(abs(i - place) <= tolerance for place in range(places)) for i in range(queries)
    ]


def nearest(frame: Fraction, places: int) -> set[int]:
    """The places of the thinned map that are nearest to a position, in places."""
    least = min(abs(frame - place) for place in range(places))
    return {place for place in range(places) if abs(frame - place) == least}


@given(
    queries=st.integers(1, 40),
    references=st.integers(1, 40),
    tolerance=st.integers(0, 3),
    every=st.integers(1, 10),
)
def test_along_every_nth_frame_a_query_is_right_within_the_tolerance_and_at_the_nearest_place(
    queries: int, references: int, tolerance: int, every: int
) -> None:
    places = len(range(0, references, every))
    truth = Truth.within(queries, references, tolerance, every)

    right = right_places(truth, places)

    for frame in range(queries):
        at = Fraction(frame, every)
        if at - tolerance > Fraction(references - 1, every):  # off the end of the reference
            assert right[frame] == set()
        else:
            within = {place for place in range(places) if abs(at - place) <= tolerance}
            assert right[frame] == within | (set() if within else nearest(at, places))


@given(
    rows=st.lists(
        st.tuples(st.integers(0, 5), st.integers(0, 24), st.integers(0, 24)).map(
            lambda row: (row[0], min(row[1:]), max(row[1:]))
        ),
        max_size=10,
    ),
    every=st.integers(1, 10),
)
def test_a_row_along_every_nth_frame_is_right_at_its_places_or_else_at_the_nearest(
    rows: list[tuple[int, int, int]], every: int
) -> None:
    query, first, last = np.array(rows, np.int64).reshape(-1, 3).T
    thinned = range(0, 25, every)
    right: dict[int, set[int]] = {frame: set() for frame in range(6)}
    for frame, a, b in rows:
        gaps = [max(a - at, at - b, 0) for at in thinned]
        right[frame] |= {place for place, gap in enumerate(gaps) if gap == min(gaps)}

    truth = Truth(6, query, first, last).thinned(25, every)

    assert right_places(truth, len(thinned)) == right


def right_places(truth: Truth, places: int) -> dict[int, set[int]]:
    answers = [truth.correct(np.full(truth.queries, place)) for place in range(places)]
    on_route = truth.on_route
    right = {
        frame: {place for place, correct in enumerate(answers) if correct[frame]}
        for frame in range(truth.queries)
    }
    assert on_route.tolist() == [bool(right[frame]) for frame in range(truth.queries)]
    return right


def test_a_negative_tolerance_is_refused() -> None:
    with pytest.raises(TruthError, match="tolerance -1"):
        Truth.within(3, 3, -1)


def test_matches_of_another_length_are_refused() -> None:
    with pytest.raises(TruthError, match="3 query frames"):
        Truth.within(3, 3, 0).correct(np.array([0, 1]))


@given(
    rows=st.lists(
        st.tuples(st.integers(0, 5), st.integers(0, 7), st.integers(0, 7)).map(
            lambda row: (row[0], min(row[1:]), max(row[1:]))
        ),
        max_size=10,
    ),
    matches=st.lists(st.integers(-1, 7), min_size=6, max_size=6),
)
def test_a_file_gives_each_query_the_union_of_its_ranges(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[int, int, int]],
    matches: list[int],
) -> None:
    path = tmp_path_factory.mktemp("truth") / "truth.csv"
    path.write_text("query,first,last\n" + "".join(f"{q},{a},{b}\n\n" for q, a, b in rows))
    right: dict[int, set[int]] = {q: set() for q in range(6)}
    for q, a, b in rows:
        right[q].update(range(a, b + 1))

    truth = read_truth(path, queries=6, places=8)

    assert truth.correct(np.array(matches)).tolist() == [
        m in right[q] for q, m in enumerate(matches)
    ]
    assert truth.on_route.tolist() == [bool(right[q]) for q in range(6)]


@given(
    rows=st.lists(
        st.tuples(st.integers(0, 5), st.integers(0, 7), st.integers(0, 7)).map(
            lambda row: (row[0], min(row[1:]), max(row[1:]))
        ),
        max_size=10,
    ),
    drive=st.lists(
        st.tuples(st.integers(0, 5), st.booleans(), st.integers(-1, 7)),  # frame, foreign, match
        max_size=12,
    ),
)
def test_a_resampled_frame_is_right_where_its_query_frame_is_and_a_foreign_one_nowhere(
    rows: list[tuple[int, int, int]], drive: list[tuple[int, bool, int]]
) -> None:
    query, first, last = np.array(rows, np.int64).reshape(-1, 3).T
    frames, foreign, matches = np.array(drive, np.int64).reshape(-1, 3).T

    truth = Truth(6, query, first, last).along(frames, foreign.astype(bool))

    assert truth.correct(matches).tolist() == [
        not other and any(q == frame and a <= match <= b for q, a, b in rows)
        for frame, other, match in drive
    ]
    assert truth.on_route.tolist() == [
        not other and any(q == frame for q, _, _ in rows) for frame, other, _ in drive
    ]


@pytest.mark.parametrize("frame", [-1, 3])
def test_frames_of_another_query_are_refused_but_foreign_frames_may_have_any_number(
    frame: int,
) -> None:
    truth, frames = Truth.within(3, 3, 0), np.array([0, frame])

    assert truth.along(frames, np.array([False, True])).on_route.tolist() == [True, False]
    with pytest.raises(TruthError, match=f"{frame}.* 3 query frames"):
        truth.along(frames, np.array([False, False]))


def test_a_spreadsheets_export_is_read(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_bytes("\ufefffirst, last, query, note\r\n 2, 3, 1, café\r\n".encode())

    assert read_truth(path, queries=2, places=4).correct(np.array([2, 3])).tolist() == [False, True]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", ":1: no column query, first, last"),
        ("query,first\n0,0\n", ":1: no column last"),
        ("query,first,last\n0,0,0\n\n1,x,2\n", ":4: first 'x' is not an integer"),
        ("query,first,last\n0,0\n", ":2: last '' is not an integer"),
        ("query,first,last\n0,0,1.5\n", ":2: last '1.5' is not an integer"),
        ("query,first,last\n0,2,1\n", ":2: first 2 is after last 1"),
        ("query,first,last\n-1,0,0\n", ":2: query -1 is not one of the 3 query frames"),
        ("query,first,last\n3,0,0\n", ":2: query 3 is not one of the 3 query frames"),
        ("query,first,last\n0,-1,0\n", ":2: first -1 is not one of the 4 places"),
        ("query,first,last\n0,0,4\n", ":2: last 4 is not one of the 4 places"),
    ],
)
def test_a_malformed_file_is_refused_in_one_line_that_names_file_and_line(
    tmp_path: Path, text: str, complaint: str
) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)

    with pytest.raises(TruthError) as error:
        read_truth(path, queries=3, places=4)

    assert str(error.value).startswith(f"{path}{complaint}")
    assert "\n" not in str(error.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00")

    for path in (tmp_path / "missing.csv", tmp_path, binary):
        with pytest.raises(TruthError, match=path.name):
            read_truth(path, queries=3, places=4)


def test_a_place_that_is_right_in_one_lap_is_right_in_every_lap() -> None:
    same = np.array([*range(10), *range(10), *range(3), 23, 24, 25], np.int32)
    truth = Truth.within(20, 20, 1).shared(same)
    right = right_places(truth, len(same))
    assert right[5] == right[15] == {4, 5, 6, 14, 15, 16}
    assert right[1] == {0, 1, 2, 10, 11, 12, 20, 21, 22}
    assert right[10] == {9, 19, 0, 1, 10, 11, 20, 21}


def test_places_between_two_that_are_right_are_right_in_a_slower_lap() -> None:
    same = np.array([*range(20), *range(0, 20, 2)], np.int32)
    right = right_places(Truth(1, *np.array([[0], [23], [25]])).shared(same), len(same))
    assert right[0] == {6, 7, 8, 9, 10, 23, 24, 25}


def test_where_all_places_differ_the_truth_stays_the_same() -> None:
    truth = Truth.within(20, 20, 1)
    assert truth.shared(np.arange(20, dtype=np.int32)) is truth
