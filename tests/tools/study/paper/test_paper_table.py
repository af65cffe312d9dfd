"""The published experiments as a table and as JSON."""

import json
from pathlib import Path

import pytest

from placefield_tools.study.paper.paper_results import PaperStudy
from placefield_tools.study.paper.paper_table import paper_figures, print_paper_study


def test_the_figures_of_both_features_are_one_json_object(paper_study: PaperStudy) -> None:
    study = json.loads(json.dumps(paper_figures(paper_study)))
    assert study["preset"] == "paper"
    assert [one["feature"] for one in study["features"]] == ["gist", "grayscale"]
    for one in study["features"]:
        assert 0.5 < one["variance_kept"] <= 1
        assert one["smallest_scale"] == 4
        assert one["invaders"]["after"] <= one["invaders"]["before"]
        assert [count["channels"] for count in one["counts"]] == [*range(1, 11)]
        assert {(line["method"], line["scales"]) for line in one["lines"]} == {
            (method, scales) for method in ("MS", "AMS") for scales in ("one", "many")
        }


def test_the_table_has_every_method_on_both_features(
    paper_study: PaperStudy, capsys: pytest.CaptureFixture[str]
) -> None:
    print_paper_study(paper_study, Path("report.html"))
    shown = capsys.readouterr().out
    for text in (
        "AMS, gist",
        "MS, gist",
        "AMS, grayscale",
        "one",
        "many",
        "SeqSLAM",
        "FAB-MAP",
        "mean AUC of one",
        "report.html",
    ):
        assert text in shown
