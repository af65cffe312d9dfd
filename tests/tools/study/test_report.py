import base64
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from placefield.config import Rule
from placefield.evaluation.claims import Claims
from placefield.evaluation.protocols import TAKES_EVERY, Protocol
from placefield.evaluation.reliability import reliability
from placefield.evaluation.truth import Truth
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield_tools.evaluate.judging import Judged, judge
from placefield_tools.evaluate.truth_source import TruthSource
from placefield_tools.plots import Neighbourhood
from placefield_tools.study import figures
from placefield_tools.study.neighbours import Learned
from placefield_tools.study.report import write_report
from placefield_tools.study.results import (
    AblationResult,
    LeftOut,
    MethodResult,
    Study,
)

_VOID = {"meta", "img", "br", "link", "input", "hr"}
_RULES: tuple[Rule, ...] = ("filter", "evidence")
FRAMES = 40

PageOf = Callable[[Study], "Page"]


class Page(HTMLParser):
    """What a browser would see; unbalanced tags are an error."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.cells: list[str] = []
        self.words = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in _VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            return
        self.words += data
        if {"td", "th"} & {*self.open}:
            self.cells[-1] += data

    def attributes(self, name: str) -> list[str]:
        return [value for _, found in self.tags if (value := found.get(name)) is not None]


def judged(right: int, *, waits: int = 0) -> Judged:
    """Of 40 frames, the last so many are right, the first so many unanswered, the others wrong."""
    places = [n if n >= FRAMES - right else (n + 20) % FRAMES for n in range(FRAMES)]
    places[:waits] = [-1] * waits
    matches = [Match(place, float(n), ()) for n, place in enumerate(places)]
    return judge(matches, Truth.within(FRAMES, FRAMES, 2))


def a_method(name: str, right: int, **changes: Any) -> MethodResult:
    method = MethodResult(name, False, False, judged(right), None, None)
    return replace(method, **changes)


def a_study(placemap: Map, **changes: Any) -> Study:
    parts: tuple[LeftOut, ...] = get_args(LeftOut)
    study = Study(
        reference="day/",
        query="dusk/",
        protocol="aligned",
        every=None,
        lowered_min_scale=None,
        seed=3,
        tolerance=2,
        placemap=placemap,
        fixed=placemap,
        learned=None,
        methods=(
            a_method("window of 4", 20, judged=judged(20, waits=3)),
            a_method("window of 8", 39, oracle=True),
            a_method("FAB-MAP", 0, judged=None, failure="no frame has a keypoint"),
            a_method("lost", 0),
            a_method("filter", 38, ours=True, judged=replace(judged(38), mean_lag=3.24)),
        ),
        ablation=tuple(
            AblationResult(rule, part, lag, judged(40 - 10 * n - lag))
            for n, part in enumerate(parts)
            for rule in _RULES
            for lag in (0, 2)
        ),
        ground=TruthSource(Truth.within(FRAMES, FRAMES, 2), "aligned", 2),
    )
    return replace(study, **changes)


def some_learned() -> Learned:
    """Two frames around a third: one of its label, one of another, which learning moves away."""
    same = np.array([True, False])
    before, after = (
        Neighbourhood(name, np.array([[2.0, 0.0], [0.0, far]]), same, same, 1.0)
        for name, far in (("before", 1.0), ("after", 4.0))
    )
    return Learned(7, before, after, invaders_before=1.0, invaders_after=0.0)


@pytest.fixture
def page_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PageOf:
    """Gives the page of a study, its pictures left white: to draw them takes seconds."""
    monkeypatch.setattr(figures, "data_url", lambda draw, **_: "data:image/webp;base64,")
    return lambda study: Page(write_report(tmp_path / "new" / "folder", study).read_text("utf-8"))


def test_the_page_needs_nothing_but_itself(tmp_path: Path, route_map: Map) -> None:
    study = a_study(route_map, learned=some_learned())
    path = write_report(tmp_path, study)

    text = path.read_text("utf-8")
    page = Page(text)
    pictures = page.attributes("src")
    assert len(pictures) == len(list(filter(None, page.attributes("alt")))) == 5
    for picture in pictures:
        kind, _, data = picture.partition(",")
        assert kind == "data:image/webp;base64"
        assert base64.b64decode(data, validate=True)[8:12] == b"WEBP"
    assert not page.attributes("href")
    assert not re.search(r"https?:|@import|url\(|<script", text)
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]
    assert text == write_report(tmp_path / "again", study).read_text("utf-8")


def test_groups_and_neighbours_are_there_or_the_page_says_why_not(
    page_of: PageOf, route_map: Map
) -> None:
    missing = {
        "There is no picture of the frames in fixed and adaptive segments": "segments of the same",
        "There is no picture of a frame's neighbours before and after": "A frame's neighbours",
    }
    full = " ".join(page_of(a_study(route_map, learned=some_learned())).words.split())
    poor = " ".join(page_of(a_study(route_map, fixed=None)).words.split())
    for sentence, heading in missing.items():
        assert heading in full
        assert sentence not in full
        assert sentence in poor
        assert heading not in poor
    assert "frame of place 7" in full
    assert "paper: figure 6" in full


def test_every_method_has_its_figures_or_says_why_not(page_of: PageOf, route_map: Map) -> None:
    study = a_study(route_map)

    cells = page_of(study).cells
    cells = cells[cells.index("Method") :]

    for method in study.methods:
        row = next(n for n, cell in enumerate(cells) if cell.startswith(method.name))
        assert ("oracle" in cells[row]) == method.oracle
        assert ("ours" in cells[row]) == method.ours
        if method.judged is None:
            assert cells[row + 1] == f"failed: {method.failure}"
            continue
        curve = method.judged.curve
        assert cells[row + 1 : row + 6] == [
            f"{value:.3f}"
            for value in (
                curve.auc,
                curve.recall_at_100_precision,
                curve.recall_at_1,
                curve.auc_of_correct,
                curve.recall_at_100_precision_of_correct,
            )
        ]
        assert cells[row + 6] == str(np.sum(method.judged.places < 0))
        assert cells[row + 7] == f"{method.judged.mean_lag:.1f}"


def test_the_report_opens_with_what_to_use_and_what_it_comes_to(
    page_of: PageOf, route_map: Map
) -> None:
    study = a_study(route_map)

    page = page_of(study)

    words = " ".join(page.words.split())
    assert (
        "filter recognises 95% of the route's frames without a wrong match, by the best threshold. "
        "The best of the other methods, window of 4, recognises 50%."
    ) in words
    assert words.index("filter recognises") < words.index("Which method recognises")
    first = page.cells.index("an answer at once, none wrong")
    assert page.cells[first + 1 : first + 5] == ["filter", "0.950", "0.950", "3.2"]


def test_what_was_left_out_is_compared_with_the_whole(page_of: PageOf, route_map: Map) -> None:
    claimed = {"nothing": Claims(30, 1.0, 0.75), "several scales": Claims(20, 0.9, 0.5)}
    study = a_study(route_map)
    ablation = tuple(
        replace(result, judged=replace(result.judged, claims=claimed.get(result.left_out)))
        if result.rule == "filter" and result.lag
        else result
        for result in study.ablation
    )
    page = page_of(replace(study, ablation=ablation))

    several = next(n for n, cell in enumerate(page.cells) if cell.startswith("several scales"))
    whole = next(n for n, cell in enumerate(page.cells) if cell.startswith("nothing"))
    headers = page.cells[whole - 14 : whole]
    assert headers[:4] == ["filter", "filter, lag 2", "evidence", "evidence, lag 2"]
    all_right, two_wrong = ["1.000", "1.000"], ["0.950", "0.950"]
    known = "0.7501.000 of the known"
    assert page.cells[whole + 1 : whole + 10] == [
        *all_right,
        *two_wrong,
        known,
        *all_right,
        *two_wrong,
    ]
    at_lag = page.cells[several + 3 : several + 6]
    assert at_lag == ["0.700−0.250", "0.700−0.250", "0.500−0.2500.900 of the known"]


def test_names_are_text_and_not_markup(page_of: PageOf, route_map: Map) -> None:
    name = """<b>R&D< "x" 'y'"""
    study = a_study(route_map, reference=name, query=name)
    failed = replace(study.methods[2], name=name, failure=name)

    page = page_of(replace(study, methods=(failed, a_method(name, 30, ours=True))))

    assert page.cells.count(f"failed: {name}") == 1
    assert f"{name}ours" in page.cells
    assert f"{name} along {name}" in page.words
    assert f"{name} recognises 75%" in page.words


@pytest.mark.parametrize("protocol", get_args(Protocol))
def test_the_drive_is_described(page_of: PageOf, route_map: Map, protocol: Protocol) -> None:
    every = 3 if protocol in TAKES_EVERY else None
    study = a_study(route_map, protocol=protocol, every=every, tolerance=None)
    study = replace(study, ground=replace(study.ground, by="given", tolerance=None))
    jumped = replace(study.methods[0], frames_to_recover=4.5)

    page = page_of(replace(study, methods=(jumped, *study.methods[1:])))

    assert f"{protocol}: " in page.words
    assert ("every 3rd frame" in page.words) == (protocol in TAKES_EVERY)
    assert "ground truth" in page.words
    assert "4.5" in page.cells


def test_shorter_segments_of_a_short_reference_are_reported(
    page_of: PageOf, route_map: Map
) -> None:
    assert "shortest segment" not in page_of(a_study(route_map)).words
    page = page_of(a_study(route_map, lowered_min_scale=2))
    assert "the shortest segment has 2 places" in " ".join(page.words.split())


def test_a_study_of_failures_is_written(page_of: PageOf, route_map: Map) -> None:
    failed = a_study(route_map).methods[2]

    page = page_of(a_study(route_map, methods=(failed,), ablation=()))

    assert "failed: no frame has a keypoint" in page.cells
    assert len(page.attributes("src")) == 3, "the bars, that say so, the segments, the groups"


def test_probabilities_are_held_to_the_answers(page_of: PageOf, route_map: Map) -> None:
    study = a_study(route_map)
    sure = replace(
        judged(20, waits=20),
        reliability=reliability(np.full(20, 0.9), np.ones(20, np.bool_)),
        claims=Claims(count=20, precision=1.0, recall=0.5),
    )

    page = page_of(replace(study, methods=(replace(study.methods[0], judged=sure),)))

    words = " ".join(page.words.split())
    assert "Reliability of window of 4 Expected calibration error 0.100" in words
    assert "it calls 20 matches known" in page.words
    assert "reliability" in page.attributes("id")
    assert "reliability" not in page_of(study).attributes("id")
