"""The reports of studies in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from test_report import a_study, some_learned

from placefield.maps.map import Map
from placefield_tools.study.paper.paper_report import write_paper_report
from placefield_tools.study.paper.paper_results import PaperStudy
from placefield_tools.study.report import write_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")


@pytest.fixture(scope="module")
def reports(
    route_map: Map, paper_study: PaperStudy, tmp_path_factory: pytest.TempPathFactory
) -> list[Path]:
    folder = tmp_path_factory.mktemp("reports")
    study = a_study(route_map, learned=some_learned())
    return [
        write_report(folder / "study", study),
        write_paper_report(folder / "paper", paper_study),
    ]


@pytest.mark.parametrize("width", [1440, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_anyone_can_read_a_report_on_any_screen(
    browser: "Browser", reports: list[Path], scheme: str, width: int
) -> None:
    for report in reports:
        page = browser.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
        page.goto(report.as_uri())
        violations = axe.Axe().run(page).response["violations"]
        assert [(one["id"], node["html"]) for one in violations for node in one["nodes"]] == []
        assert page.evaluate("document.documentElement.scrollWidth") == width, "only parts scroll"
        drawn = "[...document.images].every(one => one.complete && one.naturalWidth > 0)"
        assert page.evaluate(drawn)
        page.close()
