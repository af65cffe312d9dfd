import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from placefield_tools.study import figures as shared_figures
from placefield_tools.study.paper import paper_figures as figures
from placefield_tools.study.paper import verdicts
from placefield_tools.study.paper.paper_report import write_paper_report
from placefield_tools.study.paper.paper_results import CountResult, FeatureResult, PaperStudy
from placefield_tools.study.paper.paper_table import paper_figures, print_paper_study

_VOID = {"meta", "img", "br", "link"}


class Page(HTMLParser):
    """What a browser would see; unbalanced tags are an error."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.pictures: list[str] = []
        self.words = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "img":
            shown = dict(attrs)
            assert shown["alt"]
            self.pictures.append(shown["src"] or "")
        if tag not in _VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.words += " ".join(data.split()) + " "


def test_the_page_needs_nothing_but_itself_and_has_every_figure(
    tmp_path: Path, paper_study: PaperStudy
) -> None:
    text = write_paper_report(tmp_path, paper_study).read_text("utf-8")
    page = Page(text)
    assert len(page.pictures) == 3 + 2 * 6
    for picture in page.pictures:
        kind, _, data = picture.partition(",")
        assert kind == "data:image/webp;base64"
        assert base64.b64decode(data, validate=True)[8:12] == b"WEBP"
    assert not re.search(r"https?:|@import|url\(|<script", text)
    for heading in (
        "Precision over recall of each method paper: figures 12(a) and 13(a)",
        "AUC and recall of each method paper: figures 12(b) and 13(b)",
        "AUC and recall by number of channels paper: figures 18 to 20",
        "Autocorrelogram of each channel, gist paper: figure 1",
        "Fixed and adaptive segments of the same frames, gist paper: figures 14 and 15",
        "neighbours before and after the metric was learned, gist paper: figure 6",
    ):
        assert heading in page.words
    for result in paper_study.features:
        for line in result.lines:
            assert f"{line.judged.curve.auc:.3f}" in page.words


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are left white: to draw them takes seconds."""
    for module in (shared_figures, figures):
        monkeypatch.setattr(module, "data_url", lambda draw, **_: "data:image/webp;base64,")


@pytest.mark.usefixtures("undrawn")
def test_without_ms_ten_channels_and_words_the_page_is_there_and_says_so(
    tmp_path: Path, paper_study: PaperStudy, capsys: pytest.CaptureFixture[str]
) -> None:
    result = paper_study.features[0]
    alone = tuple(line for line in result.lines if line.method == "AMS")
    poor = replace(result, fixed=None, counts=(), lines=alone, learned=None)
    failed = replace(paper_study.others[1], judged=None, failure="no frame has a keypoint")
    study = replace(paper_study, features=(poor,), others=(failed,), query="<b>R&D")

    page = Page(write_paper_report(tmp_path, study).read_text("utf-8"))
    assert "failed: no frame has a keypoint" in page.words
    assert "<b>R&D along" in page.words
    assert "combined" not in page.words
    assert "no picture of the frames in fixed and adaptive segments" in page.words
    assert "no picture of a frame's neighbours before and after learning" in page.words
    assert paper_figures(study)["features"][0]["invaders"] is None
    print_paper_study(study, tmp_path)
    assert "no frame has a keypoint" in capsys.readouterr().out
    assert paper_figures(study)["others"] == [
        {"name": "FAB-MAP", "failure": "no frame has a keypoint"}
    ]


def with_auc(result: FeatureResult, auc: dict[tuple[str, str], float]) -> FeatureResult:
    lines = [
        replace(
            line,
            judged=replace(
                line.judged, curve=replace(line.judged.curve, auc=auc[line.method, line.scales])
            ),
        )
        for line in result.lines
    ]
    return replace(result, lines=tuple(lines))


def test_the_verdict_is_that_of_the_figures(paper_study: PaperStudy) -> None:
    figures_of = {("MS", "one"): 0.5, ("AMS", "one"): 0.495, ("MS", "many"): 0.6}
    result = with_auc(paper_study.features[0], {**figures_of, ("AMS", "many"): 0.7})
    assert verdicts.of_methods(result) == (
        "AMS, gist: on many scales it beats MS (0.700 against 0.600); on one scale it equals MS "
        "(0.495 against 0.500)"
    )
    worse = with_auc(paper_study.features[0], {**figures_of, ("AMS", "many"): 0.5})
    assert "loses to MS (0.500 against 0.600)" in (verdicts.of_methods(worse) or "")
    assert verdicts.of_methods(replace(result, lines=result.lines[2:])) is None


@pytest.mark.parametrize(
    ("eight", "said"), [(0.8, "help"), (0.705, "change next to nothing"), (0.5, "harm")]
)
def test_what_more_channels_do_is_reported_by_the_mean_of_eight(
    paper_study: PaperStudy, eight: float, said: str
) -> None:
    means = [0.7, *[0.6] * 6, eight, 0.6, 0.9]
    counts = tuple(
        CountResult(n, np.array([mean - 0.1, mean + 0.1]), np.zeros(2))
        for n, mean in enumerate(means, 1)
    )
    result = replace(paper_study.features[0], counts=counts)
    reported = verdicts.of_channels(result) or ""
    assert reported.endswith(f"more channels {said}")
    assert f"one channel 0.700, of 8 {eight:.3f}, of 10 0.900" in reported
    assert verdicts.of_channels(replace(result, counts=())) is None
