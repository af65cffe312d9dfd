"""The reports of studies in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from test_report import a_study, some_learned

from placefield.maps.map import Map
from placefield_tools.study.paper.paper_report import write_paper_report
from placefield_tools.study.paper.paper_results import PaperStudy
from placefield_tools.study.report import write_report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")


def luminances(picture: "Locator") -> NDArray[np.float64]:
    """The relative luminance of each pixel on the screen, as WCAG defines it."""
    shot = cv2.imdecode(np.frombuffer(picture.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert shot is not None
    share = shot.reshape(-1, 3)[:, ::-1] / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear @ (0.2126, 0.7152, 0.0722))


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


def test_graphs_are_dark_in_dark_colours_and_photographs_keep_theirs(
    browser: "Browser", reports: list[Path]
) -> None:
    page = browser.new_page(viewport={"width": 1440, "height": 844}, color_scheme="dark")
    for report in reports:
        page.goto(report.as_uri())
        graph = luminances(page.get_by_alt_text("bars: its AUC").first)
        ground, ink = np.median(graph), np.percentile(graph, 99.5)
        assert ground < 0.02
        assert (ink + 0.05) / (ground + 0.05) >= 4.5, "its words are read, as WCAG asks"
        frames = page.locator("img.photographs").all()
        assert frames, "they show frames"
        for picture in frames:
            assert np.median(luminances(picture)) > 0.1
    page.close()
