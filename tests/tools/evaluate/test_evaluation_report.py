import json
from pathlib import Path

import pytest

from placefield.config import Config
from placefield.evaluation.truth import Truth
from placefield.fusion.match import Match
from placefield_tools.evaluate.evaluation import evaluate
from placefield_tools.evaluate.evaluation_report import (
    certainty_figures,
    certainty_line,
    headline,
    print_table,
)
from placefield_tools.evaluate.judging import judge
from placefield_tools.evaluate.query import Query


def within_3(queries: int, places: int) -> Truth:
    return Truth.within(queries, places, 3)


def test_the_known_are_reported_with_how_many_are_right_and_how_much_of_the_route_that_is() -> None:
    matches = [Match(0, 9.0, (), 0.8, True), Match(9, 9.0, (), 0.8, True)]
    matches += [Match(2, 1.0, (), 0.8, False), Match(3, 1.0, (), 0.8, False)]
    judged = judge(matches, within_3(4, 20))
    assert certainty_line("filter", judged) == (
        "filter: 2 known, 0.500 of them right, which is 0.250 of the frames on the route; "
        "expected calibration error 0.050"
    )
    assert certainty_figures(judged)["known"] == {"count": 2, "precision": 0.5, "recall": 0.25}


def test_frames_that_are_faster_than_the_map_resolves_are_reported_where_there_are_any() -> None:
    matches = [Match(0, 9.0, (), 0.8, True)] * 2 + [Match(2, 1.0, (), 0.1, False, True)]
    judged = judge(matches, within_3(3, 20))
    line = certainty_line("filter", judged)
    assert line is not None
    assert line.startswith("filter: 2 known, ")
    assert line.endswith("; 1 of 3 frames: faster than the map resolves")
    assert certainty_figures(judged)["too_fast"] == 1


def test_no_share_is_reported_none() -> None:
    unsure = judge([Match(0, 1.0, (), 0.1, False)], within_3(1, 20))
    assert certainty_line("filter", unsure) == (
        "filter: 0 known, – of them right; expected calibration error 0.900"
    )
    assert json.loads(json.dumps(certainty_figures(unsure), allow_nan=False)) == {
        "expected_calibration_error": 0.9,
        "known": {"count": 0, "precision": None, "recall": 0.0},
        "too_fast": 0,
    }
    unanswered = judge([Match(-1, 0.0, (), 0.0, False)], within_3(1, 20))
    line = certainty_line("filter", unanswered)
    assert line == "filter: 0 known, – of them right; expected calibration error –"
    assert certainty_figures(unanswered)["expected_calibration_error"] is None


@pytest.mark.parametrize(
    ("known", "places", "words"),
    [
        ([True, True, True], [0, 1, 2], "3 of 3 frames known, all right; the first at once."),
        (
            [False, False, True],
            [0, 9, 2],
            "1 of 3 frames known, all right; first known after 2 frames.",
        ),
        (
            [False, True, True],
            [0, 9, 2],
            "2 of 3 frames known, 1 of them wrong; first known after 1 frame.",
        ),
        ([False, False, False], [0, 1, 2], "None of 3 frames known."),
    ],
)
def test_the_headline_says_what_the_drive_comes_to(
    known: list[bool], places: list[int], words: str
) -> None:
    matches = [Match(place, 1.0, (), 0.9, each) for place, each in zip(places, known, strict=True)]
    assert headline(judge(matches, within_3(3, 20))) == words


def test_one_frame_is_one_frame(
    map_path: Path, query_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "0000.jpg").write_bytes((query_dir / "0000.jpg").read_bytes())
    query = Query(str(tmp_path))
    print_table(evaluate(map_path, query, within_3, Config(), services=False), [])
    reported = capsys.readouterr().out
    assert reported.startswith(("None of 1 frame known.", "1 of 1 frame known"))
    assert "1 frame," in reported
    assert "60 places" in reported
